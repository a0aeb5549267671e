// Sums along rows, exact in 32 bits: the second half of the blur, and the window with the response.
#include "corner_vectors.inl"

namespace facetcam::FACETCAM_ISA {
namespace {

using Value = std::int16_t;

constexpr int kBlurShift = 6, kBlurHalf = 1 << (kBlurShift - 1);
static_assert((kBlurredSteps << kBlurShift) == kTapSum * kTapSum, "a blur keeps its sum");

inline float larger(float a, float b) { return a > b ? a : b; }

#ifdef FACETCAM_VECTORS
template <int R>
struct Window {
    Words pair[R + 1];

    explicit Window(const Value* taps) {
        const auto tap = [&](int i) { return i > R ? Value{} : taps[i < 0 ? -i : i]; };
        for (int k = 0; k <= R; ++k) pair[k] = pairs_of(tap(2 * k - R), tap(2 * k - R + 1));
    }
    // Sums round p, p + 2, ... or, for a pointer one further, round the others.
    Ints operator()(const Value* p) const {
        Ints sum = {};
        for (int k = 0; k <= R; ++k) sum += pair_products(load(p - R + 2 * k), pair[k]);
        return sum;
    }
};

template <int R>
void blur_radius(const Value* row, const Value* taps, int n, Value* __restrict out) {
    const Window<R> window(taps);
    const Ints half = Ints{} + kBlurHalf;
    for (int x = 0; x < n; x += kLanes)
        store(alternating((window(row + x) + half) >> kBlurShift, (window(row + x + 1) + half) >> kBlurShift),
              out + x);
}

template <int R>
void response_radius(const Value* xx, const Value* xy, const Value* yy, const Value* taps, float alpha,
                     float scale, const float* coarse, float weight, int n, float* __restrict out) {
    const Window<R> window(taps);
    const auto measure = [&](int x) {
        const Floats a = as_floats(window(xx + x)), b = as_floats(window(xy + x)),
                     c = as_floats(window(yy + x)), trace = a + c;
        return larger(scale * (a * c - b * b - alpha * (trace * trace)), Floats{});
    };
    for (int x = 0; x < n; x += kLanes) store_alternating(measure(x), measure(x + 1), out + x);
    for (int x = 0; x < n; ++x) out[x] += weight * coarse[x];
}
#else
template <int R>
int window(const Value* p, const Value* taps) {
    int sum = p[0] * taps[0];
    for (int i = 1; i <= R; ++i) sum += (p[-i] + p[i]) * taps[i];
    return sum;
}

template <int R>
void blur_radius(const Value* row, const Value* taps, int n, Value* __restrict out) {
    for (int x = 0; x < n; ++x)
        out[x] = static_cast<Value>((window<R>(row + x, taps) + kBlurHalf) >> kBlurShift);
}

template <int R>
void response_radius(const Value* xx, const Value* xy, const Value* yy, const Value* taps, float alpha,
                     float scale, const float* coarse, float weight, int n, float* __restrict out) {
    for (int x = 0; x < n; ++x) {
        const auto a = static_cast<float>(window<R>(xx + x, taps)),
                   b = static_cast<float>(window<R>(xy + x, taps)),
                   c = static_cast<float>(window<R>(yy + x, taps)), trace = a + c;
        out[x] = larger(scale * (a * c - b * b - alpha * (trace * trace)), 0.0f) + weight * coarse[x];
    }
}
#endif

}  // namespace
}  // namespace facetcam::FACETCAM_ISA
