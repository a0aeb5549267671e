#include "corners.hpp"

#include <algorithm>
#include <cmath>

#include "parallel.hpp"
#include "selection.hpp"

namespace facetcam {
namespace {

constexpr int kBandRows = 64;
constexpr int kDiscRadius = 7;          // of the orientation, pixels of the octave
constexpr float kSizePerWindow = 6.0f;  // diameter: three sigma of the window on either side
constexpr float kDegreesPerRadian = 57.29577951f;

struct BandTask {
    int level, first, last;
};

std::vector<BandTask> band_tasks(const Octaves& octaves, const std::vector<LevelSpec>& levels) {
    std::vector<BandTask> tasks;
    for (int level = 0; level < static_cast<int>(levels.size()); ++level) {
        if (levels[level].octave >= octaves.count()) continue;
        const int height = octaves.grid(levels[level].octave).height;
        for (int y = 0; y < height; y += kBandRows)
            tasks.push_back({level, y, std::min(height, y + kBandRows)});
    }
    return tasks;
}

void to_source(const OctaveGrid& grid, std::vector<Corner>& corners) {
    for (Corner& c : corners) {
        c.x = grid.origin_x + grid.step * c.x;
        c.y = grid.origin_y + grid.step * c.y;
    }
}

std::vector<Corner> all_corners(const Octaves& octaves, const DetectorOptions& options) {
    const auto tasks = band_tasks(octaves, options.levels);
    std::vector<std::vector<Corner>> found(tasks.size());
    const RowKernels& kernels = row_kernels(options.isa);
    parallel_for(static_cast<int>(tasks.size()), options.threads, [&](int i) {
        const LevelSpec& spec = options.levels[tasks[i].level];
        found[i] = detect_band(octaves, spec, tasks[i].level, options.harris, kernels, tasks[i].first,
                               tasks[i].last);
        to_source(octaves.grid(spec.octave), found[i]);
    });
    std::vector<Corner> corners;
    for (const auto& part : found) corners.insert(corners.end(), part.begin(), part.end());
    return corners;
}

void keep_allowed(std::vector<Corner>& corners, const ImageView& image, const MaskView& mask, int border) {
    const auto outside = [&](const Corner& c) {
        if (c.x < border || c.y < border || c.x > image.width - 1 - border || c.y > image.height - 1 - border)
            return true;
        return !mask.at(static_cast<int>(std::lround(c.x)), static_cast<int>(std::lround(c.y)));
    };
    corners.erase(std::remove_if(corners.begin(), corners.end(), outside), corners.end());
}

std::vector<Corner> choose(std::vector<Corner> corners, const DetectorOptions& options, int width,
                           int height) {
    std::sort(corners.begin(), corners.end(), stronger);
    const std::size_t wanted = options.max_features;
    if (options.cross_scale > 0.0f)
        corners =
            suppress_across_levels(corners, options.cross_scale, width, height, options.cell ? 0 : wanted);
    if (options.cell) corners = spread_evenly(corners, options.cell, width, wanted);
    if (wanted && corners.size() > wanted) corners.resize(wanted);
    return corners;
}

}  // namespace

std::vector<Keypoint> detect_corners(const ImageView& image, const MaskView& mask,
                                     const std::vector<float>& table, const DetectorOptions& options) {
    int count = 0;
    for (const LevelSpec& spec : options.levels) count = std::max(count, spec.octave + 1);
    const Octaves octaves(image, table, count, options.threads);
    std::vector<Corner> corners = all_corners(octaves, options);
    keep_allowed(corners, image, mask, options.border);
    corners = choose(std::move(corners), options, image.width, image.height);
    std::vector<Keypoint> keypoints;
    for (const Corner& c : corners) {
        const LevelSpec& spec = options.levels[c.level];
        const OctaveGrid& grid = octaves.grid(spec.octave);
        const float angle = options.oriented
                                ? octaves.centroid_angle(spec.octave, (c.x - grid.origin_x) / grid.step,
                                                         (c.y - grid.origin_y) / grid.step, kDiscRadius)
                                : 0.0f;
        keypoints.push_back({c.x, c.y, kSizePerWindow * spec.window_sigma * grid.step,
                             angle * kDegreesPerRadian, c.response, c.level});
    }
    return keypoints;
}

}  // namespace facetcam
