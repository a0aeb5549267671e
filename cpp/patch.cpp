#include "patch.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace facetcam {
namespace {

constexpr int kRadius = 5;
constexpr int kSide = 2 * kRadius + 1;
constexpr int kPixels = kSide * kSide;
constexpr int kPaddedSide = kSide + 2;  // one more ring for the gradient
constexpr float kConverged = 0.01f;     // px
constexpr float kFlat = 1.0f;           // grey levels of contrast below which nothing can be matched

using Window = std::array<float, kPixels>;

struct Template {
    Window value;  // zero mean
    Window dx, dy;
    float contrast;       // root of the summed squares of `value`
    float hxx, hxy, hyy;  // Gauss-Newton matrix of the gradients
    float dx_value, dy_value;
};

// Samples of the patch on a grid of the image: `taps` x `taps` to a pixel, `scale` apart.
class Sampling {
 public:
    Sampling(const Reference& r, float scale, int taps) : r_(r), scale_(scale), taps_(taps) {}

    // Tells whether a square of pixels reaches over the patch nowhere: its corners tell, a warp being affine.
    bool inside(float radius) const {
        for (const float u : {-radius, radius})
            for (const float v : {-radius, radius}) {
                const Point p = at(offset(u, u < 0 ? 0 : taps_ - 1), offset(v, v < 0 ? 0 : taps_ - 1));
                const float last = static_cast<float>(r_.size - 1);
                if (!(p.x >= 0 && p.y >= 0 && p.x < last && p.y < last)) return false;
            }
        return true;
    }

    // Mean over the footprint of one image pixel, so that a shrinking warp does not alias.
    float mean(float u, float v) const {
        float sum = 0;
        for (int j = 0; j < taps_; ++j)
            for (int i = 0; i < taps_; ++i) sum += value(at(offset(u, i), offset(v, j)));
        return sum / static_cast<float>(taps_ * taps_);
    }

 private:
    struct Point {
        float x, y;
    };

    float offset(float pixel, int tap) const { return scale_ * (pixel + (tap + 0.5f) / taps_ - 0.5f); }

    Point at(float du, float dv) const {
        const float centre = static_cast<float>(r_.size / 2);
        return {centre + r_.offset_x + r_.warp[0] * du + r_.warp[1] * dv,
                centre + r_.offset_y + r_.warp[2] * du + r_.warp[3] * dv};
    }

    float value(Point at) const {
        const int x = static_cast<int>(at.x), y = static_cast<int>(at.y);
        const float a = at.x - static_cast<float>(x), b = at.y - static_cast<float>(y);
        const std::uint8_t* p = r_.pixels + y * r_.size + x;
        return (1 - b) * ((1 - a) * p[0] + a * p[1]) + b * ((1 - a) * p[r_.size] + a * p[r_.size + 1]);
    }

    const Reference& r_;
    float scale_;
    int taps_;
};

float dot(const Window& a, const Window& b) {
    float sum = 0;
#pragma omp simd reduction(+ : sum)
    for (int i = 0; i < kPixels; ++i) sum += a[i] * b[i];
    return sum;
}

// Brings a window to zero mean and returns its contrast.
float remove_mean(Window& w) {
    float sum = 0, squares = 0;
#pragma omp simd reduction(+ : sum)
    for (int i = 0; i < kPixels; ++i) sum += w[i];
    const float mean = sum / kPixels;
#pragma omp simd reduction(+ : squares)
    for (int i = 0; i < kPixels; ++i) {
        w[i] -= mean;
        squares += w[i] * w[i];
    }
    return std::sqrt(squares);
}

bool make_template(const Reference& r, float scale, Template& t) {
    const float stretch = scale * std::sqrt(std::abs(r.warp[0] * r.warp[3] - r.warp[1] * r.warp[2]));
    if (!(stretch > 0.05f)) return false;
    const int taps = std::clamp(static_cast<int>(std::lround(stretch)), 1, 4);
    const Sampling patch(r, scale, taps);
    if (!patch.inside(kRadius + 1)) return false;
    std::array<float, kPaddedSide * kPaddedSide> padded;
    for (int v = 0; v < kPaddedSide; ++v)
        for (int u = 0; u < kPaddedSide; ++u)
            padded[v * kPaddedSide + u] =
                patch.mean(static_cast<float>(u - kRadius - 1), static_cast<float>(v - kRadius - 1));
    for (int v = 0; v < kSide; ++v)
        for (int u = 0; u < kSide; ++u) {
            const float* p = &padded[(v + 1) * kPaddedSide + u + 1];
            t.value[v * kSide + u] = p[0];
            t.dx[v * kSide + u] = 0.5f * (p[1] - p[-1]);
            t.dy[v * kSide + u] = 0.5f * (p[kPaddedSide] - p[-kPaddedSide]);
        }
    t.contrast = remove_mean(t.value);
    remove_mean(t.dx);  // a bias in the light then leaves the step unchanged
    remove_mean(t.dy);
    t.hxx = dot(t.dx, t.dx);
    t.hxy = dot(t.dx, t.dy);
    t.hyy = dot(t.dy, t.dy);
    t.dx_value = dot(t.dx, t.value);
    t.dy_value = dot(t.dy, t.value);
    return t.contrast > kFlat && t.hxx * t.hyy - t.hxy * t.hxy > 1e-3f;
}

bool read_window(const Grey8& image, float x, float y, Window& w) {
    const float left = x - kRadius, top = y - kRadius;
    const float fx = std::floor(left), fy = std::floor(top);
    if (!(fx >= 0 && fy >= 0 && fx + kSide < image.width && fy + kSide < image.height)) return false;
    const float a = left - fx, b = top - fy;
    const float w00 = (1 - a) * (1 - b), w10 = a * (1 - b), w01 = (1 - a) * b, w11 = a * b;
    const std::uint8_t* row = image.data + static_cast<int>(fy) * image.stride + static_cast<int>(fx);
    for (int v = 0; v < kSide; ++v, row += image.stride) {
        const std::uint8_t* next = row + image.stride;
        for (int u = 0; u < kSide; ++u)
            w[v * kSide + u] = w00 * row[u] + w10 * row[u + 1] + w01 * next[u] + w11 * next[u + 1];
    }
    return true;
}

// Moves (x, y) to the template; returns the correlation there, or -1.
float track(const Grey8& image, const Template& t, float max_shift, int max_iterations, float& x, float& y) {
    const float determinant = t.hxx * t.hyy - t.hxy * t.hxy;
    const float x0 = x, y0 = y;
    Window w;
    for (int k = 0; k < max_iterations; ++k) {
        if (!read_window(image, x, y, w)) return -1;
        const float contrast = remove_mean(w);
        if (contrast < kFlat) return -1;
        const float gain = t.contrast / contrast;
        const float bx = gain * dot(t.dx, w) - t.dx_value;
        const float by = gain * dot(t.dy, w) - t.dy_value;
        const float step_x = (t.hyy * bx - t.hxy * by) / determinant;
        const float step_y = (t.hxx * by - t.hxy * bx) / determinant;
        x -= step_x;
        y -= step_y;
        if (!(std::hypot(x - x0, y - y0) <= max_shift)) return -1;
        if (std::hypot(step_x, step_y) < kConverged) break;
    }
    if (!read_window(image, x, y, w)) return -1;
    const float contrast = remove_mean(w);
    if (contrast < kFlat) return -1;
    return dot(w, t.value) / (contrast * t.contrast);
}

}  // namespace

Alignment align_patch(const Grey8& full, const Grey8& half, const Reference& reference, float x, float y,
                      float max_shift, int max_iterations) {
    const Alignment failed{x, y, -1.0f, 0.0f};
    Template t;
    // Pixel centres of the half image lie between pairs of full pixels.
    float hx = 0.5f * (x - 0.5f), hy = 0.5f * (y - 0.5f);
    if (make_template(reference, 2.0f, t) &&
        track(half, t, 0.5f * max_shift, max_iterations, hx, hy) > 0.5f) {
        x = 2.0f * hx + 0.5f;
        y = 2.0f * hy + 0.5f;
    }
    if (!make_template(reference, 1.0f, t)) return failed;
    Alignment found{x, y, 0.0f, 0.0f};
    found.score = track(full, t, max_shift, max_iterations, found.x, found.y);
    if (found.score < 0) return failed;
    const float mean = 0.5f * (t.hxx + t.hyy);
    const float weaker = mean - std::hypot(0.5f * (t.hxx - t.hyy), t.hxy);
    found.spread = 1.0f / std::sqrt(std::max(weaker, 1e-6f));
    return found;
}

}  // namespace facetcam
