#include "octaves.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "parallel.hpp"

namespace facetcam {
namespace {

constexpr int kSmallestSide = 24;
constexpr int kBandRows = 64;
constexpr int kMostRadius = 12;  // of the patch that gives a direction

// Gaussian weights of the pixels `first`, `first` + 1, ... about a place.
using Weights = std::array<float, 2 * kMostRadius + 1>;

Weights gaussian(float place, int first, int count, float sigma) {
    Weights weights{};
    for (int i = 0; i < count; ++i) {
        const float off = (first + i - place) / sigma;
        weights[i] = std::exp(-0.5f * off * off);
    }
    return weights;
}

template <class Pixel, class Convert>
void read_pixels(const char* row, std::ptrdiff_t step, int n, std::int16_t* out, const Convert& convert) {
    for (int x = 0; x < n; ++x) out[x] = convert(*reinterpret_cast<const Pixel*>(row + x * step));
}

OctaveGrid halved(const OctaveGrid& g) {
    const float shift = 0.5f * g.step;
    return {(g.width + 1) / 2, (g.height + 1) / 2, g.origin_x + (g.width % 2 ? 0.0f : shift),
            g.origin_y + (g.height % 2 ? 0.0f : shift), 2.0f * g.step};
}

}  // namespace

void mirror_ends(std::int16_t* row, int n, int pad) {
    for (int i = 1; i <= pad; ++i) {
        row[-i] = row[i];
        row[n - 1 + i] = row[n - 1 - i];
    }
}

Octaves::Octaves(const ImageView& image, const std::vector<std::int16_t>& table, int count,
                 const RowKernels& kernels, int threads)
    : image_(image), table_(table), kernels_(kernels), planes_(count) {
    OctaveGrid grid{image.width, image.height, 0.0f, 0.0f, 1.0f};
    for (int octave = 0; octave < count && std::min(grid.width, grid.height) >= kSmallestSide; ++octave) {
        grids_.push_back(grid);
        if (octave > 0) build(octave, threads);
        grid = halved(grid);
    }
}

void Octaves::transfer_pixels(const char* first, int n, std::int16_t* out) const {
    const auto look_up = [this](std::size_t pixel) { return table_[pixel]; };
    const std::ptrdiff_t step = image_.column_stride;
    if (image_.type == PixelType::u8 && step == 1)
        kernels_.transfer(reinterpret_cast<const std::uint8_t*>(first), table_.data(), n, out);
    else if (image_.type == PixelType::u8)
        read_pixels<std::uint8_t>(first, step, n, out, look_up);
    else if (image_.type == PixelType::u16)
        read_pixels<std::uint16_t>(first, step, n, out, look_up);
    else
        read_pixels<std::int16_t>(first, step, n, out, [](std::int16_t value) { return value; });
}

void Octaves::read_source(int y, std::int16_t* out) const {
    transfer_pixels(static_cast<const char*>(image_.data) + y * image_.row_stride, image_.width, out);
}

std::int16_t Octaves::value(int octave, int x, int y) const {
    const OctaveGrid& grid = grids_[octave];
    x = std::clamp(x, 0, grid.width - 1);
    y = std::clamp(y, 0, grid.height - 1);
    if (octave > 0) return row(octave, y)[x];
    const char* pixel =
        static_cast<const char*>(image_.data) + y * image_.row_stride + x * image_.column_stride;
    std::int16_t out;
    transfer_pixels(pixel, 1, &out);
    return out;
}

void Octaves::read_run(int octave, int x, int y, int count, std::int16_t* out) const {
    const OctaveGrid& grid = grids_[octave];
    const bool inside = x >= 0 && x + count <= grid.width && y >= 0 && y < grid.height;
    if (inside && octave > 0) {
        std::copy_n(row(octave, y) + x, count, out);
    } else {
        for (int i = 0; i < count; ++i) out[i] = value(octave, x + i, y);
    }
}

float Octaves::gradient_angle(int octave, float x, float y, float sigma) const {
    const int cx = static_cast<int>(std::lround(x)), cy = static_cast<int>(std::lround(y));
    const int radius = std::min(static_cast<int>(std::ceil(3.0f * sigma)), kMostRadius);
    const int left = cx - radius, top = cy - radius, count = 2 * radius + 1;
    const Weights across = gaussian(x, left, count, sigma), down = gaussian(y, top, count, sigma);
    const int level = value(octave, cx, cy);  // taken away, as the weights are not quite even about the place
    float gx = 0.0f, gy = 0.0f;
    for (int j = 0; j < count; ++j) {
        std::int16_t pixels[2 * kMostRadius + 1];
        read_run(octave, left, top + j, count, pixels);
        float sum = 0.0f, moment = 0.0f;
        for (int i = 0; i < count; ++i) {
            const float weighted = across[i] * static_cast<float>(pixels[i] - level);
            sum += weighted;
            moment += weighted * (left + i - x);
        }
        gx += down[j] * moment;
        gy += down[j] * (top + j - y) * sum;
    }
    const float angle = std::atan2(gy, gx);
    return angle < 0.0f ? angle + 2.0f * static_cast<float>(M_PI) : angle;
}

void Octaves::build(int octave, int threads) {
    const OctaveGrid fine = grids_[octave - 1], coarse = grids_[octave];
    const bool odd_width = fine.width % 2, odd_height = fine.height % 2;
    const int taps = odd_height ? 5 : 4, lead = odd_height ? 2 : 1;
    const int shift = (odd_width ? 5 : 3) + (odd_height ? 5 : 3);
    const int whole = padded(coarse.width);
    planes_[octave] = Scratch<std::int16_t>(static_cast<std::size_t>(whole) * coarse.height);
    const int bands = (coarse.height + kBandRows - 1) / kBandRows;
    parallel_for(bands, threads, [&](int band) {
        Ring<std::int16_t> ring(taps + 1, fine.width), sum(1, fine.width);
        const int last = std::min(coarse.height, (band + 1) * kBandRows);
        int next = std::max(0, 2 * band * kBandRows - lead);
        for (int y = band * kBandRows; y < last; ++y) {
            const std::int16_t* rows[5];
            for (; octave == 1 && next <= std::min(2 * y - lead + taps - 1, fine.height - 1); ++next)
                read_source(next, ring[next]);
            for (int i = 0; i < taps; ++i) {
                const int source = mirrored(2 * y - lead + i, fine.height);
                rows[i] = octave == 1 ? ring[source] : row(octave - 1, source);
            }
            kernels_.halve_columns(rows, odd_height, padded(fine.width), sum[0]);
            mirror_ends(sum[0], fine.width, 2);
            kernels_.halve_row(sum[0], odd_width, shift, coarse.width,
                               planes_[octave].data() + static_cast<std::size_t>(y) * whole);
        }
    });
}

}  // namespace facetcam
