// The few vector operations that compilers do not find by themselves, for the instruction set that this is
// included for; elsewhere FACETCAM_VECTORS is not defined and plain loops are used.
#include <cstdint>
#include <cstring>

#ifdef FACETCAM_X86
#include <immintrin.h>
#define FACETCAM_VECTORS
#if defined(__AVX512BW__)
#define FACETCAM_OP(name) _mm512_##name
#define FACETCAM_REGISTER __m512i
#define FACETCAM_BYTES 64
#elif defined(__AVX2__)
#define FACETCAM_OP(name) _mm256_##name
#define FACETCAM_REGISTER __m256i
#define FACETCAM_BYTES 32
#else
#define FACETCAM_OP(name) _mm_##name
#define FACETCAM_REGISTER __m128i
#define FACETCAM_BYTES 16
#endif

namespace facetcam::FACETCAM_ISA {
namespace {

typedef std::int16_t Words __attribute__((vector_size(FACETCAM_BYTES)));
typedef std::int32_t Ints __attribute__((vector_size(FACETCAM_BYTES)));
typedef float Floats __attribute__((vector_size(FACETCAM_BYTES)));
typedef FACETCAM_REGISTER Register;

constexpr int kLanes = FACETCAM_BYTES / sizeof(std::int16_t);

inline Words load(const std::int16_t* p) {
    Words words;
    std::memcpy(&words, p, sizeof words);
    return words;
}

template <class Vector, class T>
inline void store(const Vector& vector, T* p) {
    std::memcpy(p, &vector, sizeof vector);
}

// a[2i] b[2i] + a[2i + 1] b[2i + 1]
inline Ints pair_products(Words a, Words b) {
    return reinterpret_cast<Ints>(
        FACETCAM_OP(madd_epi16)(reinterpret_cast<Register>(a), reinterpret_cast<Register>(b)));
}

// The pair (first, second) in all places.
inline Words pairs_of(std::int16_t first, std::int16_t second) {
    const std::uint32_t both = static_cast<std::uint16_t>(first) |
                               static_cast<std::uint32_t>(static_cast<std::uint16_t>(second)) << 16;
    return reinterpret_cast<Words>(Ints{} + static_cast<std::int32_t>(both));
}

// even[0], odd[0], even[1], odd[1], ... of values that fit 16 bits
inline Words alternating(Ints even, Ints odd) {
    return reinterpret_cast<Words>((even & 0xffff) | (odd << 16));
}

inline Floats as_floats(Ints ints) { return __builtin_convertvector(ints, Floats); }

inline Floats larger(Floats a, Floats b) { return a > b ? a : b; }

// Stores even[0], odd[0], even[1], odd[1], ...
inline void store_alternating(Floats even, Floats odd, float* out) {
    const auto lower = FACETCAM_OP(unpacklo_ps)(even, odd), upper = FACETCAM_OP(unpackhi_ps)(even, odd);
#if FACETCAM_BYTES == 64
    const __m512i first = _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11),
                  second = _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15);
    const __m512d a = _mm512_castps_pd(lower), b = _mm512_castps_pd(upper);
    store(_mm512_permutex2var_pd(a, first, b), out);
    store(_mm512_permutex2var_pd(a, second, b), out + 16);
#elif FACETCAM_BYTES == 32
    store(_mm256_permute2f128_ps(lower, upper, 0x20), out);
    store(_mm256_permute2f128_ps(lower, upper, 0x31), out + 8);
#else
    store(lower, out);
    store(upper, out + 4);
#endif
}

}  // namespace
}  // namespace facetcam::FACETCAM_ISA
#endif
