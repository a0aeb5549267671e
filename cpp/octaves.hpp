// The image as the detector sees it: a transfer from grey values to light-compensated values, and its
// octaves.
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "corner_kernels.hpp"
#include "ring.hpp"
#include "scratch.hpp"

namespace facetcam {

enum class PixelType { u8, u16, values };  // values: as the table gives them

// A grey image of any stride, as the caller holds it (strides in bytes).
struct ImageView {
    const void* data;
    PixelType type;
    int width, height;
    std::ptrdiff_t row_stride, column_stride;
};

// Grid of an octave in source pixels: source = origin + step * octave.
struct OctaveGrid {
    int width, height;
    float origin_x, origin_y, step;
};

// Octave 0 is read through the table; the others are stored. Halving keeps the grid centred on the image, for
// odd and even sizes alike, so a flipped or turned image has the flipped or turned octaves.
class Octaves {
 public:
    Octaves(const ImageView& image, const std::vector<std::int16_t>& table, int count,
            const RowKernels& kernels, int threads);

    int count() const { return static_cast<int>(grids_.size()); }
    const OctaveGrid& grid(int octave) const { return grids_[octave]; }
    // Writes a row of octave 0.
    void read_source(int y, std::int16_t* out) const;
    // The stored row of an octave above 0, followed by anything up to `padded(width)`.
    const std::int16_t* row(int octave, int y) const {
        return planes_[octave].data() + static_cast<std::size_t>(y) * padded(grids_[octave].width);
    }
    // Direction of the gradient of the values smoothed by a Gaussian, radians in [0, 2 pi); the point and
    // sigma in pixels of the octave.
    float gradient_angle(int octave, float x, float y, float sigma) const;

 private:
    void build(int octave, int threads);
    void transfer_pixels(const char* first, int n, std::int16_t* out) const;
    void read_run(int octave, int x, int y, int count, std::int16_t* out) const;
    std::int16_t value(int octave, int x, int y) const;

    ImageView image_;
    const std::vector<std::int16_t>& table_;
    const RowKernels& kernels_;
    std::vector<OctaveGrid> grids_;
    std::vector<Scratch<std::int16_t>> planes_;
};

// Index mirrored at the borders without repeating the border pixel.
inline int mirrored(int i, int n) { return i < 0 ? -i : i >= n ? 2 * n - 2 - i : i; }

void mirror_ends(std::int16_t* row, int n, int pad);

}  // namespace facetcam
