// Resample an image bilinearly by a table of source positions, black where there is none.
#pragma once
#include <cstddef>
#include <cstdint>

namespace facetcam {

constexpr int kFractionBits = 11;  // 1/2048 px

// Upper left source pixel and the fractions to the right and down, in 1/2048 px.
struct Source {
    std::uint16_t x, y, right, down;
};

// Output pixels [begin, end) that have a source, counted over all pictures; the first one's is
// sources[first].
struct Run {
    std::int32_t begin, end, first;
};

struct RemapTable {
    const Source* sources;
    const Run* runs;
    int run_count;
    std::int32_t pixel_count;
};

// Fills runs [from, to) of the output and the gaps before them; the last run also fills what follows.
// `stride` counts values in a source row.
template <class T, int channels>
void remap_runs(const RemapTable& table, int from, int to, const T* image, std::size_t stride, T* output);

}  // namespace facetcam
