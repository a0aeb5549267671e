#include "selection.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

#include "subpixel.hpp"

namespace facetcam {
namespace {

constexpr int kWidestWindow = 8;

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

// Index of the first nonzero byte from `i` on, or beyond the end; most bytes are zero, so eight at a time.
int next_set(const std::vector<std::uint8_t>& flags, int i) {
    const int end = static_cast<int>(flags.size() - sizeof(std::uint64_t));
    for (; i < end; i += sizeof(std::uint64_t)) {
        std::uint64_t eight;
        std::memcpy(&eight, flags.data() + i, sizeof eight);
        if (!eight) continue;
        while (!flags[i]) ++i;
        return i;
    }
    return end;
}

}  // namespace

bool stronger(const Corner& a, const Corner& b) {
    if (a.response != b.response) return a.response > b.response;
    if (a.y != b.y) return a.y < b.y;
    return a.x < b.x;
}

std::vector<Corner> find_peaks(ResponseRows& rows, int width, int height, const PeakOptions& options,
                               const RowKernels& kernels, int first, int last) {
    const int reach = options.radius, border = std::max(options.border, reach), n = width - 2 * border;
    const float least = options.threshold * kProductUnit;
    std::vector<Corner> corners;
    std::vector<std::uint8_t> flags(width + sizeof(std::uint64_t));
    for (int y = std::max(first, border); y < std::min(last, height - border); ++y) {
        const float* near[2 * kWidestWindow + 1];
        for (int j = -reach; j <= reach; ++j) near[j + reach] = rows[y + j];
        const float *above = near[reach - 1], *row = near[reach], *below = near[reach + 1];
        kernels.peaks(above + border, row + border, below + border, least * least, n, flags.data());
        for (int i = next_set(flags, 0); i < n; i = next_set(flags, i + 1)) {
            const int x = border + i;
            if (!wins_window(near, x, reach)) continue;
            const Offset d = subpixel(above + x, row + x, below + x);
            corners.push_back({x + d.x, y + d.y, std::sqrt(row[x]) / kProductUnit});
        }
    }
    return corners;
}

std::vector<Corner> spread_evenly(const std::vector<Corner>& corners, int cell, int width,
                                  std::size_t wanted) {
    const int columns = width / cell + 1;
    std::vector<int> rank(corners.size()), order(corners.size()), taken;
    for (std::size_t i = 0; i < corners.size(); ++i) {
        const std::size_t home =
            static_cast<std::size_t>(corners[i].y / cell) * columns + static_cast<int>(corners[i].x / cell);
        if (home >= taken.size()) taken.resize(home + 1);
        rank[i] = taken[home]++;
    }
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return rank[a] < rank[b]; });
    if (wanted && wanted < order.size()) order.resize(wanted);
    std::sort(order.begin(), order.end());
    std::vector<Corner> kept;
    for (int i : order) kept.push_back(corners[i]);
    return kept;
}

}  // namespace facetcam
