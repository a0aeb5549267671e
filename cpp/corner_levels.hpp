// The corner response of one scale, and of all coarser scales added to it.
#pragma once
#include <vector>

#include "corner_kernels.hpp"
#include "octaves.hpp"

namespace facetcam {

struct ResponseOptions {
    float blur_sigma, window_sigma;  // pixels of the octave
    float alpha, compression;        // compression 0: plain gradients
    float coarse_weight;             // of the next coarser scale
};

// Rows of an octave-sized map.
struct Map {
    int width = 0, height = 0;
    Scratch values;
    const float* row(int y) const { return values.data() + static_cast<std::size_t>(y) * width; }
    float* row(int y) { return values.data() + static_cast<std::size_t>(y) * width; }
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

 private:
    // Rows in a ring with mirrored pixels on both sides.
    class Ring {
     public:
        Ring(int height, int width);
        float* operator[](int y) {
            return data_.data() + static_cast<std::size_t>(y % height_) * stride_ + pad_;
        }

     private:
        int height_, pad_;
        std::size_t stride_;
        std::vector<float> data_;
    };

    void make_smooth(int y);
    void make_product(int y);
    void make_response(int y);
    const float* coarse_row(int y);
    const float* source_row(int y);
    void filter_rows(Ring& ring, int y, const std::vector<float>& taps, float* out);
    void filter_columns(float* row, const std::vector<float>& taps, float* out);

    const Octaves& octaves_;
    const Map* coarse_;
    const ResponseOptions& options_;
    const RowKernels& kernels_;
    const int octave_, width_, height_;
    const std::vector<float> blur_, window_;
    Ring source_, smooth_, xx_, xy_, yy_, response_, windowed_, column_, stretched_;
    int next_source_, next_smooth_, next_product_, next_response_;
};

}  // namespace facetcam
