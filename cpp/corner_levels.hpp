// The corner response of one scale, and of all coarser scales added to it.
#pragma once
#include <vector>

#include "corner_kernels.hpp"
#include "octaves.hpp"
#include "ring.hpp"

namespace facetcam {

struct ResponseOptions {
    float blur_sigma, window_sigma;  // pixels of the octave
    float alpha, compression;
    float coarse_weight;  // of the next coarser scale
};

constexpr int kMaxRadius = 8;  // of a Gaussian; the kernels know no larger one

// An octave-sized map; its rows may be written up to `padded(width)`.
struct Map {
    int width = 0, height = 0;
    Scratch<float> values;
    const float* row(int y) const { return values.data() + static_cast<std::size_t>(y) * padded(width); }
    float* row(int y) { return values.data() + static_cast<std::size_t>(y) * padded(width); }
};

// Value of the coarser map at a pixel of the finer octave, between its pixels bilinearly.
float upsampled(const Map& coarse, const OctaveGrid& fine, int x, int y);

// Response rows of one octave, made in rising order; a row stays valid while `kept` later ones are made.
class ResponseRows {
 public:
    // `coarse` may be null: nothing is added. Rows before `first` are never asked for.
    ResponseRows(const Octaves& octaves, int octave, const Map* coarse, const ResponseOptions& options,
                 const RowKernels& kernels, int first, int kept);

    // The row, with all rows up to it made; y in [0, height).
    const float* operator[](int y);
    // Makes the next row elsewhere; those made in between are not kept.
    void make_next(float* out);

 private:
    using Taps = std::vector<std::int16_t>;

    void make_smooth(int y);
    void make_product(int y);
    void make_response(int y, float* out);
    const float* coarse_row(int y);
    const std::int16_t* source_row(int y);

    const Octaves& octaves_;
    const Map* coarse_;
    const ResponseOptions& options_;
    const RowKernels& kernels_;
    const int octave_, width_, height_, whole_;
    const Taps blur_, window_;
    Ring<std::int16_t> source_, smooth_, xx_, xy_, yy_, windowed_, column_;
    Ring<float> response_, stretched_;
    int next_source_, next_smooth_, next_product_, next_response_;
};

}  // namespace facetcam
