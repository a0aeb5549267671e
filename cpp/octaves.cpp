#include "octaves.hpp"

#include <algorithm>
#include <cmath>

#include "parallel.hpp"

namespace facetcam {
namespace {

constexpr int kSmallestSide = 24;
constexpr int kBandRows = 32;

template <class Pixel>
void transfer(const char* row, std::ptrdiff_t step, int n, const float* table, float* out) {
    for (int x = 0; x < n; ++x) out[x] = table[*reinterpret_cast<const Pixel*>(row + x * step)];
}

void copy_floats(const char* row, std::ptrdiff_t step, int n, float* out) {
    for (int x = 0; x < n; ++x) out[x] = *reinterpret_cast<const float*>(row + x * step);
}

// Both smoothings have a variance of 0.75 pixels^2, so every octave keeps the blur of the one before.
// Even sizes: [1 3 3 1] / 8 between two pixels; odd sizes: [1 8 14 8 1] / 32 on a pixel.
void halve_row(const float* in, bool odd, int n, float* out) {
    if (odd) {
        for (int x = 0; x < n; ++x) {
            const float* p = in + 2 * x;
            out[x] = 0.4375f * p[0] + 0.25f * (p[-1] + p[1]) + 0.03125f * (p[-2] + p[2]);
        }
    } else {
        for (int x = 0; x < n; ++x) {
            const float* p = in + 2 * x;
            out[x] = 0.375f * (p[0] + p[1]) + 0.125f * (p[-1] + p[2]);
        }
    }
}

void halve_column(const float* const* rows, bool odd, int n, float* out) {
    const float *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3];
    if (odd) {
        const float* e = rows[4];
        for (int x = 0; x < n; ++x)
            out[x] = 0.4375f * c[x] + 0.25f * (b[x] + d[x]) + 0.03125f * (a[x] + e[x]);
    } else {
        for (int x = 0; x < n; ++x) out[x] = 0.375f * (b[x] + c[x]) + 0.125f * (a[x] + d[x]);
    }
}

OctaveGrid halved(const OctaveGrid& g) {
    const float shift = 0.5f * g.step;
    return {(g.width + 1) / 2, (g.height + 1) / 2, g.origin_x + (g.width % 2 ? 0.0f : shift),
            g.origin_y + (g.height % 2 ? 0.0f : shift), 2.0f * g.step};
}

}  // namespace

void mirror_ends(float* row, int n, int pad) {
    for (int i = 1; i <= pad; ++i) {
        row[-i] = row[i];
        row[n - 1 + i] = row[n - 1 - i];
    }
}

Octaves::Octaves(const ImageView& image, const std::vector<float>& table, int count, int threads)
    : image_(image), table_(table), planes_(count) {
    OctaveGrid grid{image.width, image.height, 0.0f, 0.0f, 1.0f};
    for (int octave = 0; octave < count && std::min(grid.width, grid.height) >= kSmallestSide; ++octave) {
        grids_.push_back(grid);
        if (octave > 0) build(octave, threads);
        grid = halved(grid);
    }
}

void Octaves::transfer_row(int y, float* out) const {
    const char* row = static_cast<const char*>(image_.data) + y * image_.row_stride;
    if (image_.type == PixelType::u8)
        transfer<std::uint8_t>(row, image_.column_stride, image_.width, table_.data(), out);
    else if (image_.type == PixelType::u16)
        transfer<std::uint16_t>(row, image_.column_stride, image_.width, table_.data(), out);
    else
        copy_floats(row, image_.column_stride, image_.width, out);
}

void Octaves::read_row(int octave, int y, int pad, float* out) const {
    const int n = grids_[octave].width;
    if (octave == 0)
        transfer_row(y, out);
    else
        std::copy_n(planes_[octave].data() + static_cast<std::size_t>(y) * n, n, out);
    mirror_ends(out, n, pad);
}

float Octaves::value(int octave, int x, int y) const {
    const OctaveGrid& grid = grids_[octave];
    x = std::clamp(x, 0, grid.width - 1);
    y = std::clamp(y, 0, grid.height - 1);
    if (octave > 0) return planes_[octave][static_cast<std::size_t>(y) * grid.width + x];
    const char* pixel =
        static_cast<const char*>(image_.data) + y * image_.row_stride + x * image_.column_stride;
    if (image_.type == PixelType::u8) return table_[*reinterpret_cast<const std::uint8_t*>(pixel)];
    if (image_.type == PixelType::u16) return table_[*reinterpret_cast<const std::uint16_t*>(pixel)];
    return *reinterpret_cast<const float*>(pixel);
}

float Octaves::centroid_angle(int octave, float x, float y, int radius) const {
    const int cx = static_cast<int>(std::lround(x)), cy = static_cast<int>(std::lround(y));
    float mx = 0.0f, my = 0.0f;
    for (int j = -radius; j <= radius; ++j)
        for (int i = -radius; i <= radius; ++i) {
            if (i * i + j * j > radius * (radius + 1)) continue;
            const float v = value(octave, cx + i, cy + j);
            mx += i * v;
            my += j * v;
        }
    const float angle = std::atan2(my, mx);
    return angle < 0.0f ? angle + 2.0f * static_cast<float>(M_PI) : angle;
}

void Octaves::build(int octave, int threads) {
    const OctaveGrid fine = grids_[octave - 1], coarse = grids_[octave];
    const bool odd_width = fine.width % 2, odd_height = fine.height % 2;
    const int taps = odd_height ? 5 : 4, lead = odd_height ? 2 : 1;
    planes_[octave].resize(static_cast<std::size_t>(coarse.width) * coarse.height);
    const int bands = (coarse.height + kBandRows - 1) / kBandRows;
    parallel_for(bands, threads, [&](int band) {
        constexpr int kPad = 2, kRing = 8;
        const int stride = fine.width + 2 * kPad;
        std::vector<float> ring(static_cast<std::size_t>(kRing) * stride), sum(stride);
        const auto slot = [&](int y) { return ring.data() + (y % kRing) * stride + kPad; };
        const int last = std::min(coarse.height, (band + 1) * kBandRows);
        int next = std::max(0, 2 * band * kBandRows - lead);
        for (int y = band * kBandRows; y < last; ++y) {
            const float* rows[5];
            for (; next <= std::min(2 * y - lead + taps - 1, fine.height - 1); ++next)
                read_row(octave - 1, next, kPad, slot(next));
            for (int i = 0; i < taps; ++i) rows[i] = slot(mirrored(2 * y - lead + i, fine.height)) - kPad;
            halve_column(rows, odd_height, stride, sum.data());
            halve_row(sum.data() + kPad, odd_width, coarse.width,
                      planes_[octave].data() + static_cast<std::size_t>(y) * coarse.width);
        }
    });
}

}  // namespace facetcam
