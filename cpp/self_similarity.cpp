#include "self_similarity.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace facetcam {
namespace {

constexpr int kLanes = 2 * kMostRadius + 2;  // columns of a window are padded to as many

// Sums over windows of an image, from those over all that is above and left of a pixel. These may wrap round;
// their differences do not.
struct WindowSums {
    int stride;
    std::vector<std::uint32_t> sums;

    template <class Value>
    WindowSums(int size, Value value) : stride(size + 1), sums(stride * stride) {
        for (int y = 0; y < size; ++y) {
            std::uint32_t row = 0;
            for (int x = 0; x < size; ++x) {
                row += static_cast<std::uint32_t>(value(x, y));
                sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + row;
            }
        }
    }

    std::uint32_t operator()(int left, int top, int width) const {
        const std::uint32_t* above = &sums[top * stride + left];
        const std::uint32_t* below = above + width * stride;
        return below[width] - below[0] - above[width] + above[0];
    }
};

struct Smoothed {
    int size, stride;
    std::vector<std::int16_t> pixels;  // four times as bright; rows end in zeros

    Smoothed(const std::uint8_t* patch, int size) : size(size), stride(size + kLanes), pixels(size * stride) {
        std::vector<std::int16_t> rows(size * size);
        for (int y = 0; y < size; ++y) {
            const std::uint8_t* row = patch + y * size;
            for (int x = 0; x < size; ++x)
                rows[y * size + x] = static_cast<std::int16_t>(row[std::max(x - 1, 0)] + 2 * row[x] +
                                                               row[std::min(x + 1, size - 1)]);
        }
        for (int y = 0; y < size; ++y) {
            const std::int16_t *row = &rows[y * size], *above = y ? row - size : row,
                               *below = y + 1 < size ? row + size : row;
            for (int x = 0; x < size; ++x)
                pixels[y * stride + x] =
                    static_cast<std::int16_t>((above[x] + 2 * row[x] + below[x] + 2) >> 2);
        }
    }

    std::int32_t at(int x, int y) const { return pixels[y * stride + x]; }
};

}  // namespace

Likeness self_similarity(const std::uint8_t* patch, int size, int x, int y, int radius, float apart) {
    const int width = 2 * radius + 1, left = x - radius, top = y - radius;
    Likeness best{-1.0f, 0.0f, 0.0f};
    if (left < 0 || top < 0 || left + width > size || top + width > size) return best;
    const Smoothed image(patch, size);
    const WindowSums sums(size, [&](int u, int v) { return image.at(u, v); });
    const WindowSums squares(size, [&](int u, int v) { return image.at(u, v) * image.at(u, v); });
    std::vector<std::int16_t> window(width * kLanes);
    for (int v = 0; v < width; ++v)
        std::copy_n(&image.pixels[(top + v) * image.stride + left], width, &window[v * kLanes]);
    const double n = width * width, sum = sums(left, top, width);
    const double energy = n * squares(left, top, width) - sum * sum;
    for (int v = 0; v + width <= size; ++v)
        for (int u = 0; u + width <= size; ++u) {
            const int dx = u - left, dy = v - top;
            if (static_cast<float>(dx * dx + dy * dy) < apart * apart) continue;
            std::int32_t product = 0;
            for (int row = 0; row < width; ++row) {
                const std::int16_t* a = &window[row * kLanes];
                const std::int16_t* b = &image.pixels[(v + row) * image.stride + u];
                for (int k = 0; k < kLanes; ++k) product += a[k] * b[k];
            }
            const double other = sums(u, v, width);
            const double spread = energy * (n * squares(u, v, width) - other * other);
            if (!(spread > 0.0)) continue;
            const auto correlation = static_cast<float>((n * product - sum * other) / std::sqrt(spread));
            if (correlation > best.correlation)
                best = {correlation, static_cast<float>(dx), static_cast<float>(dy)};
        }
    return best;
}

}  // namespace facetcam
