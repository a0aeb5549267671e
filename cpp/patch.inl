// Included once per instruction set with FACETCAM_ISA naming the namespace. No standard-library templates
// here: an inline function compiled for AVX-512 must never be the copy the linker keeps for everybody.
#include "patch.hpp"
#include "patch_lanes.inl"

namespace facetcam::FACETCAM_ISA {
namespace {

constexpr int kRadius = 5;
constexpr int kSide = 2 * kRadius + 1;
constexpr int kPixels = kSide * kSide;
constexpr int kPaddedSide = kSide + 2;  // one more ring for the gradient
constexpr int kMaxTaps = 4;
constexpr float kConverged = 0.01f;  // px
constexpr float kFlat = 1.0f;        // grey levels of contrast below which nothing can be matched

// Rows of `kSide` pixels; the other lanes are zero.
struct alignas(64) Window {
    float row[kSide][kRow];
};

struct Template {
    Window value;  // zero mean
    Window dx, dy;
    float contrast;       // root of the summed squares of `value`
    float hxx, hxy, hyy;  // Gauss-Newton matrix of the gradients
    float dx_value, dy_value;
};

float root(float square) { return __builtin_sqrtf(square); }

// One in the lanes of a window, zero in the others.
constexpr float kInside[kRow] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
// Columns of the padded window round its centre; lanes beyond its last one repeat that.
constexpr float kColumns[kRow] = {-6, -5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5, 6, 6, 6, 6};
static_assert(kSide == 11 && kPaddedSide == 13, "the rows above are for eleven and thirteen pixels");

// Samples of the patch on a grid of the image: `taps` x `taps` to a pixel, `scale` apart.
class Sampling {
 public:
    Sampling(const Reference& r, float scale, int taps) : r_(r), scale_(scale), taps_(taps) {}

    // Tells whether a square of pixels reaches over the patch nowhere: its corners tell, a warp being affine.
    bool inside(float radius) const {
        const float last = static_cast<float>(r_.size - 1);
        for (int right = 0; right < 2; ++right)
            for (int below = 0; below < 2; ++below) {
                const float du = offset(right ? radius : -radius, right ? taps_ - 1 : 0);
                const float dv = offset(below ? radius : -radius, below ? taps_ - 1 : 0);
                const float x = left() + r_.warp[0] * du + r_.warp[1] * dv;
                const float y = top() + r_.warp[2] * du + r_.warp[3] * dv;
                if (!(x >= 0 && y >= 0 && x < last && y < last)) return false;
            }
        return true;
    }

    // Means over the footprints of the image pixels `u`, v, so that a shrinking warp does not alias.
    Row means(const Row& u, float v) const {
        Row sum = {};
        for (int j = 0; j < taps_; ++j)
            for (int i = 0; i < taps_; ++i)
                for (int k = 0; k < kParts; ++k) sum.part[k] += values(offset(u.part[k], i), offset(v, j));
        for (int k = 0; k < kParts; ++k) sum.part[k] /= static_cast<float>(taps_ * taps_);
        return sum;
    }

 private:
    float left() const { return static_cast<float>(r_.size / 2) + r_.offset_x; }
    float top() const { return static_cast<float>(r_.size / 2) + r_.offset_y; }

    template <class T>
    T offset(T pixel, int tap) const {
        return scale_ * (pixel + ((tap + 0.5f) / taps_ - 0.5f));
    }

    Floats values(Floats du, float dv) const {
        const Floats x = (left() + r_.warp[0] * du) + r_.warp[1] * dv;
        const Floats y = (top() + r_.warp[2] * du) + r_.warp[3] * dv;
        const Ints column = __builtin_convertvector(x, Ints), row = __builtin_convertvector(y, Ints);
        const Floats a = x - as_floats(column), b = y - as_floats(row);
        const Ints index = row * r_.size + column;
        // Four bytes from the upper pair on, and up to the lower pair: never beyond the patch.
        const Ints upper = gather(r_.pixels, index), lower = gather(r_.pixels + r_.size - 2, index);
        const Floats p00 = as_floats(upper & 255), p10 = as_floats((upper >> 8) & 255);
        const Floats p01 = as_floats((lower >> 16) & 255), p11 = as_floats((lower >> 24) & 255);
        return (1 - b) * ((1 - a) * p00 + a * p10) + b * ((1 - a) * p01 + a * p11);
    }

    const Reference& r_;
    float scale_;
    int taps_;
};

float dot(const Window& a, const Window& b) {
    Row sum = {};
    for (int v = 0; v < kSide; ++v) {
        const Row p = load(a.row[v]), q = load(b.row[v]);
        for (int k = 0; k < kParts; ++k) sum.part[k] += p.part[k] * q.part[k];
    }
    return total(sum);
}

// Brings a window to zero mean and returns its contrast.
float remove_mean(Window& w) {
    Row sum = {}, squares = {}, mean = load(kInside);
    for (int v = 0; v < kSide; ++v) {
        const Row row = load(w.row[v]);
        for (int k = 0; k < kParts; ++k) sum.part[k] += row.part[k];
    }
    const float each = total(sum) / kPixels;
    for (int k = 0; k < kParts; ++k) mean.part[k] *= each;
    for (int v = 0; v < kSide; ++v) {
        Row row = load(w.row[v]);
        for (int k = 0; k < kParts; ++k) {
            row.part[k] -= mean.part[k];
            squares.part[k] += row.part[k] * row.part[k];
        }
        store(row, w.row[v]);
    }
    return root(total(squares));
}

int taps_of(float stretch) {
    return stretch < 1.5f ? 1 : stretch < kMaxTaps ? static_cast<int>(stretch + 0.5f) : kMaxTaps;
}

bool make_template(const Reference& r, float scale, Template& t) {
    const float stretch = scale * root(__builtin_fabsf(r.warp[0] * r.warp[3] - r.warp[1] * r.warp[2]));
    if (!(stretch > 0.05f)) return false;
    const Sampling patch(r, scale, taps_of(stretch));
    if (!patch.inside(kRadius + 1)) return false;
    float padded[kPaddedSide][kRow + 2] = {};  // as far as the differences below reach
    const Row u = load(kColumns), inside = load(kInside);
    for (int v = 0; v < kPaddedSide; ++v)
        store(patch.means(u, static_cast<float>(v - kRadius - 1)), padded[v]);
    for (int v = 0; v < kSide; ++v) {
        const float* p = padded[v + 1];
        const Row here = load(p + 1), left = load(p), right = load(p + 2), above = load(padded[v] + 1),
                  below = load(padded[v + 2] + 1);
        Row value, dx, dy;
        for (int k = 0; k < kParts; ++k) {
            value.part[k] = inside.part[k] * here.part[k];
            dx.part[k] = 0.5f * inside.part[k] * (right.part[k] - left.part[k]);
            dy.part[k] = 0.5f * inside.part[k] * (below.part[k] - above.part[k]);
        }
        store(value, t.value.row[v]);
        store(dx, t.dx.row[v]);
        store(dy, t.dy.row[v]);
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

// A row of pixels, drawn by `a` towards their neighbours on the right.
Row drawn(const std::uint8_t* pixels, float a) {
    static_assert(kSide == 11 && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "twelve bytes are read");
    std::uint64_t low, next;
    std::uint32_t last;
    std::memcpy(&low, pixels, 8);
    std::memcpy(&next, pixels + 1, 8);
    std::memcpy(&last, pixels + 8, 4);
    Row row = row_of(low, last & 0xffffff);
    const Row right = row_of(next, last >> 8);
    for (int k = 0; k < kParts; ++k) row.part[k] += a * (right.part[k] - row.part[k]);
    return row;
}

bool read_window(const Grey8& image, float x, float y, Window& w) {
    const float left = x - kRadius, top = y - kRadius;
    const float fx = __builtin_floorf(left), fy = __builtin_floorf(top);
    if (!(fx >= 0 && fy >= 0 && fx + kSide < image.width && fy + kSide < image.height)) return false;
    const float a = left - fx, b = top - fy;
    const std::uint8_t* pixels = image.data + static_cast<int>(fy) * image.stride + static_cast<int>(fx);
    Row above = drawn(pixels, a);
    for (int v = 0; v < kSide; ++v) {
        pixels += image.stride;
        const Row below = drawn(pixels, a);
        for (int k = 0; k < kParts; ++k) above.part[k] += b * (below.part[k] - above.part[k]);
        store(above, w.row[v]);
        above = below;
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
        if (!(root((x - x0) * (x - x0) + (y - y0) * (y - y0)) <= max_shift)) return -1;
        if (root(step_x * step_x + step_y * step_y) < kConverged) break;
    }
    if (!read_window(image, x, y, w)) return -1;
    const float contrast = remove_mean(w);
    if (contrast < kFlat) return -1;
    return dot(w, t.value) / (contrast * t.contrast);
}

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
    const float mean = 0.5f * (t.hxx + t.hyy), difference = 0.5f * (t.hxx - t.hyy);
    const float weaker = mean - root(difference * difference + t.hxy * t.hxy);
    found.spread = 1.0f / root(weaker > 1e-6f ? weaker : 1e-6f);
    return found;
}

}  // namespace

extern AlignPatch* const aligner = align_patch;

}  // namespace facetcam::FACETCAM_ISA
