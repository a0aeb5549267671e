#include "selection.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace facetcam {
namespace {

// Buckets of kept corners, as wide as the radius: a neighbour lies in one of nine.
class Buckets {
 public:
    Buckets(float side, int width, int height)
        : side_(side),
          columns_(static_cast<int>(width / side) + 3),
          heads_(static_cast<std::size_t>(columns_) * (static_cast<int>(height / side) + 3), -1) {}

    bool crowded(const Corner& corner, const std::vector<Corner>& kept) const {
        for (int j = -1; j <= 1; ++j)
            for (int i = -1; i <= 1; ++i)
                for (int k = heads_[index(corner) + j * columns_ + i]; k >= 0; k = next_[k])
                    if (kept[k].level != corner.level &&
                        std::hypot(kept[k].x - corner.x, kept[k].y - corner.y) <= side_)
                        return true;
        return false;
    }

    void add(const Corner& corner) {
        int& head = heads_[index(corner)];
        next_.push_back(head);
        head = static_cast<int>(next_.size()) - 1;
    }

 private:
    int index(const Corner& c) const {
        return (static_cast<int>(c.y / side_) + 1) * columns_ + static_cast<int>(c.x / side_) + 1;
    }

    float side_;
    int columns_;
    std::vector<int> heads_, next_;
};

}  // namespace

bool stronger(const Corner& a, const Corner& b) {
    if (a.response != b.response) return a.response > b.response;
    if (a.y != b.y) return a.y < b.y;
    return a.x != b.x ? a.x < b.x : a.level < b.level;
}

std::vector<Corner> suppress_across_levels(const std::vector<Corner>& corners, float radius, int width,
                                           int height, std::size_t wanted) {
    Buckets buckets(radius, width, height);
    std::vector<Corner> kept;
    for (const Corner& corner : corners) {
        if (wanted && kept.size() == wanted) break;
        if (buckets.crowded(corner, kept)) continue;
        buckets.add(corner);
        kept.push_back(corner);
    }
    return kept;
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
