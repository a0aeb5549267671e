#include "corners.hpp"

#include <algorithm>
#include <cmath>

#include "parallel.hpp"

namespace facetcam {
namespace {

constexpr int kLeastBandRows = 64;
constexpr int kShare = 128;             // corners of one task
constexpr float kSizePerWindow = 8.0f;  // diameter: four sigma of the window on either side
constexpr float kAngleSigma = 0.25f;    // of the Gaussian under which the direction is taken, in sizes
constexpr float kDegreesPerRadian = 57.29577951f;

// Rows of one task: every band computes some rows of its neighbours again, so few bands, but enough to share.
int band_rows(int height, int threads) {
    const int share = threads > 1 ? height / (2 * threads) : height;
    return std::max(kLeastBandRows, share);
}

// Calls task(band, first row, last row) for bands of rows that together cover the height.
template <class Task>
void for_bands(int height, int threads, const Task& task) {
    const int rows = band_rows(height, threads);
    parallel_for((height + rows - 1) / rows, threads,
                 [&](int band) { task(band, band * rows, std::min(height, (band + 1) * rows)); });
}

// Summed responses of the octaves above 0; maps[octave], the coarsest first made.
std::vector<Map> coarse_maps(const Octaves& octaves, const DetectorOptions& options,
                             const RowKernels& kernels) {
    std::vector<Map> maps(std::min(options.scales, octaves.count()));
    for (int octave = static_cast<int>(maps.size()) - 1; octave > 0; --octave) {
        Map& map = maps[octave];
        map.width = octaves.grid(octave).width;
        map.height = octaves.grid(octave).height;
        map.values = Scratch<float>(static_cast<std::size_t>(padded(map.width)) * map.height);
        const Map* coarse = octave + 1 < static_cast<int>(maps.size()) ? &maps[octave + 1] : nullptr;
        for_bands(map.height, options.threads, [&](int, int first, int last) {
            ResponseRows rows(octaves, octave, coarse, options.response, kernels, first, 0);
            for (int y = first; y < last; ++y) rows.make_next(map.row(y));
        });
    }
    return maps;
}

void drop_masked(std::vector<Corner>& corners, const MaskView& mask) {
    const auto masked = [&](const Corner& c) {
        return !mask.at(static_cast<int>(std::lround(c.x)), static_cast<int>(std::lround(c.y)));
    };
    corners.erase(std::remove_if(corners.begin(), corners.end(), masked), corners.end());
}

// Leaves the strongest, in any order, where those are all that is asked for.
void keep_strongest(std::vector<Corner>& corners, const DetectorOptions& options) {
    const std::size_t wanted = options.max_features;
    if (!wanted || options.cell || wanted >= corners.size()) return;
    std::nth_element(corners.begin(), corners.begin() + wanted, corners.end(), stronger);
    corners.resize(wanted);
}

// Corners that the mask allows; what is too weak in its band is dropped there, by the band's own thread.
std::vector<Corner> all_corners(const Octaves& octaves, const std::vector<Map>& maps, const MaskView& mask,
                                const DetectorOptions& options, const RowKernels& kernels) {
    const int width = octaves.grid(0).width, height = octaves.grid(0).height, reach = options.peaks.radius;
    std::vector<std::vector<Corner>> found(height / kLeastBandRows + 1);
    for_bands(height, options.threads, [&](int band, int first, int last) {
        ResponseRows rows(octaves, 0, maps.size() > 1 ? &maps[1] : nullptr, options.response, kernels,
                          first - reach, 2 * reach);
        found[band] = find_peaks(rows, width, height, options.peaks, kernels, first, last);
        drop_masked(found[band], mask);
        keep_strongest(found[band], options);
    });
    std::vector<Corner> corners;
    for (const auto& part : found) corners.insert(corners.end(), part.begin(), part.end());
    return corners;
}

std::vector<Corner> choose(std::vector<Corner> corners, const DetectorOptions& options, int width) {
    keep_strongest(corners, options);
    std::sort(corners.begin(), corners.end(), stronger);
    return options.cell ? spread_evenly(corners, options.cell, width, options.max_features) : corners;
}

// The responses of the single octaves at a corner, from the sum of their squares and the coarser sums.
std::vector<float> own_responses(const Octaves& octaves, const std::vector<Map>& maps, const Corner& corner,
                                 float coarse_weight) {
    std::vector<float> own;
    const float root = corner.response * kProductUnit;
    float sum = root * root;
    for (std::size_t octave = 0; octave < maps.size(); ++octave) {
        float coarse = 0.0f;
        if (octave + 1 < maps.size()) {
            const OctaveGrid& grid = octaves.grid(static_cast<int>(octave));
            const auto nearest = [&](float place, float origin, int size) {
                return std::clamp(static_cast<int>(std::lround((place - origin) / grid.step)), 0, size - 1);
            };
            coarse = upsampled(maps[octave + 1], grid, nearest(corner.x, grid.origin_x, grid.width),
                               nearest(corner.y, grid.origin_y, grid.height));
        }
        own.push_back(std::sqrt(std::max(0.0f, sum - coarse_weight * coarse)));
        sum = coarse;
    }
    return own;
}

struct Scale {
    int octave;
    float sigma;  // of the window, source pixels
};

// The octave that answers most, and between the octaves the peak of the parabola through its neighbours;
// outside of the octaves there is no response.
Scale best_scale(const Octaves& octaves, const std::vector<float>& own, float window_sigma) {
    const auto best = std::max_element(own.begin(), own.end());
    const float finer = best == own.begin() ? 0.0f : best[-1],
                coarser = best + 1 == own.end() ? 0.0f : best[1];
    const float bend = finer + coarser - 2.0f * *best;
    const float shift = bend < 0.0f ? std::clamp(0.5f * (finer - coarser) / bend, -0.5f, 0.5f) : 0.0f;
    const int octave = static_cast<int>(best - own.begin());
    return {octave, window_sigma * octaves.grid(octave).step * std::exp2(shift)};
}

Keypoint with_size_and_angle(const Octaves& octaves, const std::vector<Map>& maps, const Corner& corner,
                             const DetectorOptions& options) {
    const ResponseOptions& response = options.response;
    const auto own = own_responses(octaves, maps, corner, response.coarse_weight);
    const auto [octave, sigma] = best_scale(octaves, own, response.window_sigma);
    const float size = kSizePerWindow * sigma;
    float angle = 0.0f;
    if (options.oriented) {
        const int above = std::min(octave + 1, octaves.count() - 1);
        const OctaveGrid& grid = octaves.grid(above);
        angle = kDegreesPerRadian * octaves.gradient_angle(above, (corner.x - grid.origin_x) / grid.step,
                                                           (corner.y - grid.origin_y) / grid.step,
                                                           kAngleSigma * size / grid.step);
    }
    if (angle >= 360.0f) angle = 0.0f;  // just below 2 pi may round up
    return {corner.x, corner.y, size, angle, corner.response, octave};
}

}  // namespace

std::vector<Keypoint> detect_corners(const ImageView& image, const MaskView& mask,
                                     const std::vector<std::int16_t>& table, const DetectorOptions& options) {
    const RowKernels& kernels = row_kernels(options.isa);
    // One octave more than scales: directions come from the octave above a corner's.
    const Octaves octaves(image, table, options.scales + 1, kernels, options.threads);
    if (octaves.count() == 0) return {};
    const std::vector<Map> maps = coarse_maps(octaves, options, kernels);
    const std::vector<Corner> corners =
        choose(all_corners(octaves, maps, mask, options, kernels), options, image.width);
    std::vector<Keypoint> keypoints(corners.size());
    const int shares = (static_cast<int>(corners.size()) + kShare - 1) / kShare;
    parallel_for(shares, options.threads, [&](int share) {
        const std::size_t first = static_cast<std::size_t>(share) * kShare;
        for (std::size_t i = first; i < std::min(corners.size(), first + kShare); ++i)
            keypoints[i] = with_size_and_angle(octaves, maps, corners[i], options);
    });
    return keypoints;
}

}  // namespace facetcam
