#include "corner_levels.hpp"

#include <algorithm>
#include <cmath>

namespace facetcam {
namespace {

constexpr int kMaxRadius = 8;  // of a Gaussian; the kernels know no larger one

// Cut at two sigma and normalised; the centre first.
std::vector<float> gaussian_taps(float sigma) {
    const int radius = std::clamp(static_cast<int>(std::lround(2.0f * sigma)), 1, kMaxRadius);
    std::vector<double> weights(radius + 1);
    double total = 0.0;
    for (int i = 0; i <= radius; ++i) {
        weights[i] = std::exp(-0.5 * i * i / (static_cast<double>(sigma) * sigma));
        total += (i ? 2.0 : 1.0) * weights[i];
    }
    std::vector<float> taps;
    for (double weight : weights) taps.push_back(static_cast<float>(weight / total));
    return taps;
}

int radius_of(const std::vector<float>& taps) { return static_cast<int>(taps.size()) - 1; }

// The two coarse indices round fine index i and the weight of the first. An even size has its coarse pixels
// between two fine ones, an odd size on every second (see octaves.hpp).
struct Neighbours {
    int first, second;
    float weight;
};

Neighbours coarse_neighbours(int i, int fine_size, int coarse_size) {
    if (fine_size % 2) return {i / 2, (i + 1) / 2, 0.5f};
    const int near = i / 2, far = i % 2 ? near + 1 : near - 1;
    return {near, std::clamp(far, 0, coarse_size - 1), 0.75f};
}

}  // namespace

float upsampled(const Map& coarse, const OctaveGrid& fine, int x, int y) {
    const Neighbours across = coarse_neighbours(x, fine.width, coarse.width);
    const Neighbours down = coarse_neighbours(y, fine.height, coarse.height);
    const auto along = [&](const float* row) {
        return across.weight * row[across.first] + (1.0f - across.weight) * row[across.second];
    };
    return down.weight * along(coarse.row(down.first)) +
           (1.0f - down.weight) * along(coarse.row(down.second));
}

ResponseRows::Ring::Ring(int height, int width)
    : height_(height),
      pad_(kMaxRadius),
      stride_(width + 2 * kMaxRadius),
      data_(static_cast<std::size_t>(height) * stride_) {}

ResponseRows::ResponseRows(const Octaves& octaves, int octave, const Map* coarse,
                           const ResponseOptions& options, const RowKernels& kernels, int first, int kept)
    : octaves_(octaves),
      coarse_(coarse),
      options_(options),
      kernels_(kernels),
      octave_(octave),
      width_(octaves.grid(octave).width),
      height_(octaves.grid(octave).height),
      blur_(gaussian_taps(options.blur_sigma)),
      window_(gaussian_taps(options.window_sigma)),
      source_(2 * radius_of(blur_) + 1, width_),
      smooth_(3, width_),
      xx_(2 * radius_of(window_) + 1, width_),
      xy_(2 * radius_of(window_) + 1, width_),
      yy_(2 * radius_of(window_) + 1, width_),
      response_(kept + 1, width_),
      windowed_(3, width_),
      column_(1, width_),
      stretched_(1, width_) {
    next_response_ = std::max(0, first);
    next_product_ = std::max(0, next_response_ - radius_of(window_));
    next_smooth_ = std::max(0, next_product_ - 1);
    next_source_ = std::max(0, next_smooth_ - radius_of(blur_));
}

const float* ResponseRows::operator[](int y) {
    for (; next_response_ <= y; ++next_response_) make_response(next_response_);
    return response_[y];
}

void ResponseRows::filter_rows(Ring& ring, int y, const std::vector<float>& taps, float* out) {
    const float* rows[2 * kMaxRadius + 1];
    const int radius = radius_of(taps);
    for (int i = -radius; i <= radius; ++i) rows[i + radius] = ring[mirrored(y + i, height_)];
    kernels_.symmetric_filter(rows, taps.data(), radius, width_, out);
}

void ResponseRows::filter_columns(float* row, const std::vector<float>& taps, float* out) {
    const float* rows[2 * kMaxRadius + 1];
    const int radius = radius_of(taps);
    mirror_ends(row, width_, radius);
    for (int i = -radius; i <= radius; ++i) rows[i + radius] = row + i;
    kernels_.symmetric_filter(rows, taps.data(), radius, width_, out);
}

const float* ResponseRows::source_row(int y) { return octave_ ? octaves_.row(octave_, y) : source_[y]; }

void ResponseRows::make_smooth(int y) {
    const int radius = radius_of(blur_);
    for (; octave_ == 0 && next_source_ <= std::min(y + radius, height_ - 1); ++next_source_)
        octaves_.read_row(0, next_source_, 0, source_[next_source_]);
    const float* rows[2 * kMaxRadius + 1];
    for (int i = -radius; i <= radius; ++i) rows[i + radius] = source_row(mirrored(y + i, height_));
    kernels_.symmetric_filter(rows, blur_.data(), radius, width_, column_[0]);
    filter_columns(column_[0], blur_, smooth_[y]);
    mirror_ends(smooth_[y], width_, 1);
}

void ResponseRows::make_product(int y) {
    for (; next_smooth_ <= std::min(y + 1, height_ - 1); ++next_smooth_) make_smooth(next_smooth_);
    const float gain = 0.5f * options_.blur_sigma;
    kernels_.gradient_products(smooth_[mirrored(y - 1, height_)], smooth_[y],
                               smooth_[mirrored(y + 1, height_)], gain, options_.compression, width_, xx_[y],
                               xy_[y], yy_[y]);
}

void ResponseRows::make_response(int y) {
    const int radius = radius_of(window_);
    for (; next_product_ <= std::min(y + radius, height_ - 1); ++next_product_) make_product(next_product_);
    Ring* products[] = {&xx_, &xy_, &yy_};
    for (int i = 0; i < 3; ++i) {
        filter_rows(*products[i], y, window_, windowed_[i]);
        mirror_ends(windowed_[i], width_, radius);
    }
    kernels_.corner_response(windowed_[0], windowed_[1], windowed_[2], window_.data(), radius, options_.alpha,
                             coarse_row(y), options_.coarse_weight, width_, response_[y]);
}

const float* ResponseRows::coarse_row(int y) {
    if (coarse_) {
        const Neighbours rows = coarse_neighbours(y, height_, coarse_->height);
        kernels_.blend(coarse_->row(rows.first), coarse_->row(rows.second), rows.weight, coarse_->width,
                       column_[0]);
        kernels_.stretch_row(column_[0], width_ % 2, coarse_->width, stretched_[0]);
    }
    return stretched_[0];  // zeros where there is no coarser scale
}

}  // namespace facetcam
