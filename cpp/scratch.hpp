// Large buffers that a thread keeps from one call to the next: fresh ones cost more in page faults than the
// work done in them.
#pragma once
#include <cstddef>
#include <utility>
#include <vector>

namespace facetcam {

// A buffer of at least `size` values (not cleared), returned to its thread's store when it dies.
template <class T>
class Scratch {
 public:
    Scratch() = default;
    explicit Scratch(std::size_t size) {
        auto& store = stored();
        if (!store.empty()) {
            values_ = std::move(store.back());
            store.pop_back();
        }
        if (values_.size() < size) values_.resize(size);
    }
    Scratch(Scratch&& other) noexcept : values_(std::move(other.values_)) { other.values_.clear(); }
    Scratch& operator=(Scratch&& other) noexcept {
        std::swap(values_, other.values_);
        return *this;
    }
    ~Scratch() {
        if (!values_.empty()) stored().push_back(std::move(values_));
    }

    T* data() { return values_.data(); }
    const T* data() const { return values_.data(); }

 private:
    static std::vector<std::vector<T>>& stored() {
        thread_local std::vector<std::vector<T>> store;
        return store;
    }

    std::vector<T> values_;
};

}  // namespace facetcam
