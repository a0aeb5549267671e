// Rows of sixteen floats, in as many registers as the instruction set needs that this is included for.
#include <cstdint>
#include <cstring>

#ifdef FACETCAM_X86
#include <immintrin.h>
#endif
#ifdef __AVX2__
#define FACETCAM_LANES 8
#else
#define FACETCAM_LANES 4
#endif

namespace facetcam::FACETCAM_ISA {
namespace {

constexpr int kRow = 16, kParts = kRow / FACETCAM_LANES;

typedef float Floats __attribute__((vector_size(4 * FACETCAM_LANES)));
typedef std::int32_t Ints __attribute__((vector_size(4 * FACETCAM_LANES)));
typedef float Quad __attribute__((vector_size(16)));

struct Row {
    Floats part[kParts];
};

// Part by part: compilers copy a whole row through memory.
inline Row load(const float* p) {
    Row row;
    for (int k = 0; k < kParts; ++k) std::memcpy(&row.part[k], p + k * FACETCAM_LANES, sizeof(Floats));
    return row;
}

inline void store(const Row& row, float* p) {
    for (int k = 0; k < kParts; ++k) std::memcpy(p + k * FACETCAM_LANES, &row.part[k], sizeof(Floats));
}

inline Floats as_floats(Ints ints) { return __builtin_convertvector(ints, Floats); }

// Sixteen bytes, the first eight of them in `low`.
inline Row row_of(std::uint64_t low, std::uint64_t high) {
    Row row;
#if FACETCAM_LANES == 8
    row.part[0] = _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_cvtsi64_si128(low)));
    row.part[1] = _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_cvtsi64_si128(high)));
#elif defined(FACETCAM_X86)
    const __m128i none = _mm_setzero_si128();
    const __m128i words[] = {_mm_unpacklo_epi8(_mm_cvtsi64_si128(low), none),
                             _mm_unpacklo_epi8(_mm_cvtsi64_si128(high), none)};
    for (int k = 0; k < 2; ++k) {
        row.part[2 * k] = _mm_cvtepi32_ps(_mm_unpacklo_epi16(words[k], none));
        row.part[2 * k + 1] = _mm_cvtepi32_ps(_mm_unpackhi_epi16(words[k], none));
    }
#else
    float lanes[kRow];
    for (int i = 0; i < kRow; ++i) lanes[i] = static_cast<float>((i < 8 ? low : high) >> 8 * (i % 8) & 255);
    row = load(lanes);
#endif
    return row;
}

// The sum of a row, halves folded upon each other.
inline float total(const Row& row) {
#if FACETCAM_LANES == 8
    const Floats eight = row.part[0] + row.part[1];
    const Quad four = _mm256_castps256_ps128(eight) + _mm256_extractf128_ps(eight, 1);
#else
    const Quad four = (row.part[0] + row.part[2]) + (row.part[1] + row.part[3]);
#endif
    return (four[0] + four[2]) + (four[1] + four[3]);
}

// Four bytes each from `base` + index, the first one lowest. The instructions for it are slower.
inline Ints gather(const std::uint8_t* base, Ints index) {
    Ints found;
    for (int i = 0; i < FACETCAM_LANES; ++i) {
        std::int32_t four;
        std::memcpy(&four, base + index[i], sizeof four);
        found[i] = four;
    }
    return found;
}

}  // namespace
}  // namespace facetcam::FACETCAM_ISA
