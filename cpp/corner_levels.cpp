#include "corner_levels.hpp"

#include <algorithm>
#include <cmath>

#include "subpixel.hpp"

namespace facetcam {
namespace {

constexpr int kPad = 12;
constexpr int kMaxRadius = 8;

// Rows of one stage in a ring; rows are made in rising order and live as long as the ring is high.
class Ring {
 public:
    Ring(int height, int width)
        : height_(height), stride_(width + 2 * kPad), data_(static_cast<std::size_t>(height) * stride_) {}
    float* operator[](int y) { return data_.data() + static_cast<std::size_t>(y % height_) * stride_ + kPad; }

 private:
    int height_;
    std::size_t stride_;
    std::vector<float> data_;
};

// Pulls rows through the stages, so that every row of every stage is made once and stays in the cache.
class Band {
 public:
    Band(const Octaves& octaves, const LevelSpec& spec, const HarrisOptions& options,
         const RowKernels& kernels, int first)
        : octaves_(octaves),
          options_(options),
          kernels_(kernels),
          octave_(spec.octave),
          width_(octaves.grid(spec.octave).width),
          height_(octaves.grid(spec.octave).height),
          blur_(gaussian_taps(spec.blur_sigma)),
          window_(gaussian_taps(spec.window_sigma)),
          gain_(0.5f * spec.blur_sigma),
          source_(2 * kMaxRadius + 2, width_),
          smooth_(4, width_),
          xx_(2 * kMaxRadius + 2, width_),
          xy_(2 * kMaxRadius + 2, width_),
          yy_(2 * kMaxRadius + 2, width_),
          response_(2 * options.suppression + 2, width_),
          column_(3, width_) {
        next_response_ = std::max(0, first - options.suppression);
        next_product_ = std::max(0, next_response_ - radius(window_));
        next_smooth_ = std::max(0, next_product_ - 1);
        next_source_ = std::max(0, next_smooth_ - radius(blur_));
    }

    const float* response(int y) {
        for (; next_response_ <= std::min(y, height_ - 1); ++next_response_) make_response(next_response_);
        return response_[y];
    }

    int width() const { return width_; }
    int height() const { return height_; }

 private:
    static int radius(const std::vector<float>& taps) { return static_cast<int>(taps.size()) - 1; }

    void filter_rows(Ring& ring, int y, const std::vector<float>& taps, float* out) {
        const float* rows[2 * kMaxRadius + 1];
        const int r = radius(taps);
        for (int i = -r; i <= r; ++i) rows[i + r] = ring[mirrored(y + i, height_)];
        kernels_.symmetric_filter(rows, taps.data(), r, width_, out);
    }

    void filter_columns(float* row, const std::vector<float>& taps, float* out) {
        const float* rows[2 * kMaxRadius + 1];
        const int r = radius(taps);
        mirror_ends(row, width_, r);
        for (int i = -r; i <= r; ++i) rows[i + r] = row + i;
        kernels_.symmetric_filter(rows, taps.data(), r, width_, out);
    }

    void make_smooth(int y) {
        for (; next_source_ <= std::min(y + radius(blur_), height_ - 1); ++next_source_)
            octaves_.read_row(octave_, next_source_, 0, source_[next_source_]);
        filter_rows(source_, y, blur_, column_[0]);
        filter_columns(column_[0], blur_, smooth_[y]);
        mirror_ends(smooth_[y], width_, 1);
    }

    void make_product(int y) {
        for (; next_smooth_ <= std::min(y + 1, height_ - 1); ++next_smooth_) make_smooth(next_smooth_);
        kernels_.gradient_products(smooth_[mirrored(y - 1, height_)], smooth_[y],
                                   smooth_[mirrored(y + 1, height_)], gain_, options_.compression, width_,
                                   xx_[y], xy_[y], yy_[y]);
    }

    void make_response(int y) {
        for (; next_product_ <= std::min(y + radius(window_), height_ - 1); ++next_product_)
            make_product(next_product_);
        Ring* products[] = {&xx_, &xy_, &yy_};
        float* windowed[3];
        for (int i = 0; i < 3; ++i) {
            windowed[i] = column_[i];
            filter_rows(*products[i], y, window_, smooth_row_.data() + kPad);
            filter_columns(smooth_row_.data() + kPad, window_, windowed[i]);
        }
        kernels_.harris(windowed[0], windowed[1], windowed[2], options_.alpha, width_, response_[y]);
    }

    const Octaves& octaves_;
    const HarrisOptions& options_;
    const RowKernels& kernels_;
    int octave_, width_, height_;
    std::vector<float> blur_, window_;
    float gain_;
    Ring source_, smooth_, xx_, xy_, yy_, response_, column_;
    std::vector<float> smooth_row_ = std::vector<float>(width_ + 2 * kPad);
    int next_source_, next_smooth_, next_product_, next_response_;
};

// The total order breaks ties, so of equal neighbours exactly one wins.
bool wins_window(const float* const* rows, int x, int radius) {
    const float own = rows[radius][x];
    for (int j = 0; j <= 2 * radius; ++j)
        for (int i = x - radius; i <= x + radius; ++i) {
            const bool before = j < radius || (j == radius && i < x);
            if (rows[j][i] > own || (before && rows[j][i] == own)) return false;
        }
    return true;
}

}  // namespace

std::vector<float> gaussian_taps(float sigma) {
    const int radius = std::clamp(static_cast<int>(std::lround(2.0f * sigma)), 1, kMaxRadius);
    std::vector<double> weights(radius + 1);
    double total = 0.0;
    for (int i = 0; i <= radius; ++i) {
        weights[i] = std::exp(-0.5 * i * i / (static_cast<double>(sigma) * sigma));
        total += (i ? 2.0 : 1.0) * weights[i];
    }
    std::vector<float> taps;
    for (double w : weights) taps.push_back(static_cast<float>(w / total));
    return taps;
}

std::vector<Corner> detect_band(const Octaves& octaves, const LevelSpec& spec, int level,
                                const HarrisOptions& options, const RowKernels& kernels, int first,
                                int last) {
    Band band(octaves, spec, options, kernels, first);
    const int reach = options.suppression, border = std::max(reach, 3);
    std::vector<Corner> corners;
    std::vector<std::uint8_t> flags(band.width());
    const int n = band.width() - 2 * border;
    for (int y = std::max(first, border); y < std::min(last, band.height() - border); ++y) {
        const float* rows[2 * kMaxRadius + 1];
        band.response(y + reach);
        for (int j = -reach; j <= reach; ++j) rows[j + reach] = band.response(y + j);
        kernels.peaks(rows[reach - 1] + border, rows[reach] + border, rows[reach + 1] + border, options.floor,
                      n, flags.data());
        for (int i = 0; i < n; ++i) {
            const int x = border + i;
            if (!flags[i] || !wins_window(rows, x, reach)) continue;
            const Offset d = subpixel(rows[reach - 1] + x, rows[reach] + x, rows[reach + 1] + x);
            corners.push_back({x + d.x, y + d.y, rows[reach][x], level});
        }
    }
    return corners;
}

}  // namespace facetcam
