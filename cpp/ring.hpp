// Rows of working memory, aligned and long enough for kernels to work on whole registers.
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace facetcam {

constexpr int kWholeRegisters = 64;  // values; kernels may work on up to this many more than a row has

inline int padded(int width) { return (width + kWholeRegisters - 1) / kWholeRegisters * kWholeRegisters; }

// The last rows of an image, with room for mirrored pixels on both sides.
template <class T>
class Ring {
 public:
    Ring(int rows, int width) : stride_(padded(width) + 2 * kWholeRegisters) {
        while (mask_ + 1 < static_cast<unsigned>(rows)) mask_ = 2 * mask_ + 1;  // a power of two: no division
        data_.resize((mask_ + 1) * stride_ + kWholeRegisters);
        const auto address = reinterpret_cast<std::uintptr_t>(data_.data());
        first_ = data_.data() + (-address % (kWholeRegisters * sizeof(T))) / sizeof(T) + kWholeRegisters;
    }
    Ring(const Ring&) = delete;
    T* operator[](int y) { return first_ + (static_cast<unsigned>(y) & mask_) * stride_; }

 private:
    unsigned mask_ = 0;
    std::size_t stride_;
    std::vector<T> data_;
    T* first_;
};

}  // namespace facetcam
