// Matching of binary descriptors by Hamming distance.
#pragma once
#include <cstdint>
#include <vector>

namespace facetcam {

struct Descriptors {
    const std::uint8_t* data;  // count x bytes, packed
    int count, bytes;
};

struct MatchLimits {
    int max_distance;  // bits
    float ratio;       // best <= ratio * second best; 1 or more: no test
};

// Hamming distances of all pairs, query.count x train.count.
std::vector<std::int32_t> hamming_distances(const Descriptors& query, const Descriptors& train);

// For every query the group of train descriptors, below `groups`, that is nearest by any of them and whose
// nearest query it is in turn, or -1. The second best is another group's.
std::vector<std::int32_t> match_mutual(const Descriptors& query, const Descriptors& train,
                                       const std::int32_t* group, int groups, const MatchLimits& limits);

struct Places {
    const float* xy;           // count x 2, pixels
    const std::int32_t* view;  // count
};

// For every query the nearest train descriptor of the same view within `radius` pixels, or -1. A train
// descriptor wanted by several queries goes to the nearest one.
std::vector<std::int32_t> match_windowed(const Descriptors& query, const Places& query_places,
                                         const Descriptors& train, const Places& train_places, float radius,
                                         const MatchLimits& limits);

}  // namespace facetcam
