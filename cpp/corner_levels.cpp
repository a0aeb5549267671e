#include "corner_levels.hpp"

#include <algorithm>
#include <cmath>

namespace facetcam {
namespace {

constexpr float kContrast = 0.05f;  // a gradient that is as strong whatever the compression

// Gaussian cut at two sigma, rounded to taps whose sum is kTapSum; the centre first.
std::vector<std::int16_t> gaussian(float sigma) {
    const int radius = std::clamp(static_cast<int>(std::lround(2.0f * sigma)), 1, kMaxRadius);
    std::vector<double> weights(radius + 1);
    double sum = 0.0;
    for (int i = 0; i <= radius; ++i) {
        weights[i] = std::exp(-0.5 * i * i / (static_cast<double>(sigma) * sigma));
        sum += (i ? 2.0 : 1.0) * weights[i];
    }
    std::vector<std::int16_t> taps{kTapSum};
    for (int i = 1; i <= radius; ++i) {
        taps.push_back(static_cast<std::int16_t>(std::lround(kTapSum * weights[i] / sum)));
        taps[0] = static_cast<std::int16_t>(taps[0] - 2 * taps[i]);
    }
    return taps;
}

int radius_of(const std::vector<std::int16_t>& taps) { return static_cast<int>(taps.size()) - 1; }

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

ResponseRows::ResponseRows(const Octaves& octaves, int octave, const Map* coarse,
                           const ResponseOptions& options, const RowKernels& kernels, int first, int kept)
    : octaves_(octaves),
      coarse_(coarse),
      options_(options),
      kernels_(kernels),
      octave_(octave),
      width_(octaves.grid(octave).width),
      height_(octaves.grid(octave).height),
      whole_(padded(width_)),
      blur_(gaussian(options.blur_sigma)),
      window_(gaussian(options.window_sigma)),
      source_(2 * radius_of(blur_) + 1, width_),
      smooth_(3, width_),
      xx_(2 * radius_of(window_) + 1, width_),
      xy_(2 * radius_of(window_) + 1, width_),
      yy_(2 * radius_of(window_) + 1, width_),
      windowed_(3, width_),
      column_(1, width_),
      response_(kept + 1, width_),
      stretched_(1, width_) {
    next_response_ = std::max(0, first);
    next_product_ = std::max(0, next_response_ - radius_of(window_));
    next_smooth_ = std::max(0, next_product_ - 1);
    next_source_ = std::max(0, next_smooth_ - radius_of(blur_));
}

const float* ResponseRows::operator[](int y) {
    for (; next_response_ <= y; ++next_response_) make_response(next_response_, response_[next_response_]);
    return response_[y];
}

void ResponseRows::make_next(float* out) { make_response(next_response_++, out); }

const std::int16_t* ResponseRows::source_row(int y) {
    return octave_ ? octaves_.row(octave_, y) : source_[y];
}

void ResponseRows::make_smooth(int y) {
    const int radius = radius_of(blur_);
    for (; octave_ == 0 && next_source_ <= std::min(y + radius, height_ - 1); ++next_source_)
        octaves_.read_source(next_source_, source_[next_source_]);
    const std::int16_t* rows[2 * kMaxRadius + 1];
    for (int i = -radius; i <= radius; ++i) rows[i + radius] = source_row(mirrored(y + i, height_));
    kernels_.filter_columns(rows, blur_.data(), radius, whole_, column_[0]);
    mirror_ends(column_[0], width_, radius);
    kernels_.blur_row(column_[0], blur_.data(), radius, whole_, smooth_[y]);
    mirror_ends(smooth_[y], width_, 1);
}

void ResponseRows::make_product(int y) {
    for (; next_smooth_ <= std::min(y + 1, height_ - 1); ++next_smooth_) make_smooth(next_smooth_);
    // In steps of blurred values: h = 2 g / sigma, and products of g / (g^2 + c^2)^(1/4) in steps of
    // products.
    const float c = options_.compression, unit = 0.5f * options_.blur_sigma / (kBlurredSteps * kValueUnit);
    const float level = std::sqrt((c * c + kContrast * kContrast) / (2.0f * kContrast * kContrast));
    const float floor = std::max(c * c / (unit * unit), 1.0f);
    const float gain = kProductUnit * unit * level;
    // The largest h with gain h^2 / sqrt(h^2 + floor) <= kLargestStep, as the kernel's root is 3.5 % off.
    const float bound = kLargestStep / (1.035f * gain), square = bound * bound;
    const float largest = std::sqrt(0.5f * (square + std::sqrt(square * (square + 4.0f * floor))));
    const auto most = static_cast<std::int16_t>(std::min(largest, 32767.0f));
    kernels_.gradient_products(smooth_[mirrored(y - 1, height_)], smooth_[y],
                               smooth_[mirrored(y + 1, height_)], gain, floor, most, whole_, xx_[y], xy_[y],
                               yy_[y]);
}

void ResponseRows::make_response(int y, float* out) {
    const int radius = radius_of(window_);
    for (; next_product_ <= std::min(y + radius, height_ - 1); ++next_product_) make_product(next_product_);
    Ring<std::int16_t>* products[] = {&xx_, &xy_, &yy_};
    for (int i = 0; i < 3; ++i) {
        const std::int16_t* rows[2 * kMaxRadius + 1];
        for (int j = -radius; j <= radius; ++j) rows[j + radius] = (*products[i])[mirrored(y + j, height_)];
        kernels_.filter_columns(rows, window_.data(), radius, whole_, windowed_[i]);
        mirror_ends(windowed_[i], width_, radius);
    }
    constexpr float kSum = kTapSum * kTapSum;  // of the windows across and down
    kernels_.corner_response(windowed_[0], windowed_[1], windowed_[2], window_.data(), radius, options_.alpha,
                             1.0f / (kSum * kSum), coarse_row(y), options_.coarse_weight, whole_, out);
}

const float* ResponseRows::coarse_row(int y) {
    if (coarse_) {
        const Neighbours rows = coarse_neighbours(y, height_, coarse_->height);
        kernels_.stretch(coarse_->row(rows.first), coarse_->row(rows.second), rows.weight, width_ % 2,
                         coarse_->width, stretched_[0]);
    }
    return stretched_[0];  // zeros where there is no coarser scale
}

}  // namespace facetcam
