// The window over the products of gradients and the response: sums of 16-bit products in 32 bits.
#include "corner_vectors.inl"

namespace facetcam::FACETCAM_ISA {
namespace {

using Value = std::int16_t;

inline float larger(float a, float b) { return a > b ? a : b; }

#ifdef FACETCAM_VECTORS
template <int R>
void window_radius(const Value* const* rows, const Value* taps, int n, Value* __restrict out) {
    constexpr int kPairs = R / 2 + 1;
    Words pair[kPairs];
    for (int k = 0; k < kPairs; ++k) pair[k] = pairs_of(taps[2 * k], 2 * k < R ? taps[2 * k + 1] : Value{});
    const Ints half = Ints{} + (1 << 14);
    for (int x = 0; x < n; x += kLanes) {
        Ints lower = half, upper = half;
        for (int k = 0; k < kPairs; ++k) {
            const int i = 2 * k, j = i < R ? i + 1 : i;
            const Words a = i ? load(rows[R - i] + x) + load(rows[R + i] + x) : load(rows[R] + x);
            const Words b = j ? load(rows[R - j] + x) + load(rows[R + j] + x) : a;
            lower += pair_products(lower_pairs(a, b), pair[k]);
            upper += pair_products(upper_pairs(a, b), pair[k]);
        }
        store(joined(lower >> 15, upper >> 15), out + x);
    }
}

template <int R>
struct Window {
    Words pair[R + 1];

    explicit Window(const Value* taps) {
        const auto tap = [&](int i) { return i > R ? Value{} : taps[i < 0 ? -i : i]; };
        for (int k = 0; k <= R; ++k) pair[k] = pairs_of(tap(2 * k - R), tap(2 * k - R + 1));
    }
    // Sums round p, p + 2, ... or, for a pointer one further, round the others.
    Floats operator()(const Value* p) const {
        Ints sum = {};
        for (int k = 0; k <= R; ++k) sum += pair_products(load(p - R + 2 * k), pair[k]);
        return as_floats(sum);
    }
};

template <int R>
void response_radius(const Value* xx, const Value* xy, const Value* yy, const Value* taps, float alpha,
                     float scale, const float* coarse, float weight, int n, float* __restrict out) {
    const Window<R> window(taps);
    const auto measure = [&](int x) {
        const Floats a = window(xx + x), b = window(xy + x), c = window(yy + x), trace = a + c;
        return larger(scale * (a * c - b * b - alpha * (trace * trace)), Floats{});
    };
    for (int x = 0; x < n; x += kLanes) store_alternating(measure(x), measure(x + 1), out + x);
    for (int x = 0; x < n; ++x) out[x] += weight * coarse[x];
}
#else
template <int R>
void window_radius(const Value* const* rows, const Value* taps, int n, Value* __restrict out) {
    for (int x = 0; x < n; ++x) {
        int sum = rows[R][x] * taps[0] + (1 << 14);
        for (int i = 1; i <= R; ++i) sum += static_cast<Value>(rows[R - i][x] + rows[R + i][x]) * taps[i];
        out[x] = static_cast<Value>(sum >> 15);
    }
}

template <int R>
void response_radius(const Value* xx, const Value* xy, const Value* yy, const Value* taps, float alpha,
                     float scale, const float* coarse, float weight, int n, float* __restrict out) {
    const auto window = [&](const Value* p) {
        int sum = p[0] * taps[0];
        for (int i = 1; i <= R; ++i) sum += p[-i] * taps[i] + p[i] * taps[i];
        return static_cast<float>(sum);
    };
    for (int x = 0; x < n; ++x) {
        const float a = window(xx + x), b = window(xy + x), c = window(yy + x), trace = a + c;
        out[x] = larger(scale * (a * c - b * b - alpha * (trace * trace)), 0.0f) + weight * coarse[x];
    }
}
#endif

}  // namespace
}  // namespace facetcam::FACETCAM_ISA
