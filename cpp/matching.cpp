#include "matching.hpp"

#include <algorithm>
#include <climits>
#include <cmath>
#include <cstring>

namespace facetcam {
namespace {

#if defined(__x86_64__) && defined(__GNUC__)
#define FACETCAM_POPCOUNT_CLONES __attribute__((target_clones("popcnt", "default")))
#else
#define FACETCAM_POPCOUNT_CLONES
#endif

// Hamming distances of one query to descriptors [first, last) of a packed block.
FACETCAM_POPCOUNT_CLONES
void distances(const std::uint8_t* query, const std::uint8_t* train, int bytes, int count, int* out) {
    for (int k = 0; k < count; ++k, train += bytes) {
        int bits = 0, i = 0;
        for (; i + 8 <= bytes; i += 8) {
            std::uint64_t a, b;
            std::memcpy(&a, query + i, 8);
            std::memcpy(&b, train + i, 8);
            bits += __builtin_popcountll(a ^ b);
        }
        for (; i < bytes; ++i) bits += __builtin_popcount(query[i] ^ train[i]);
        out[k] = bits;
    }
}

// The smallest distance seen, the index it belongs to, of equals the lowest, and the smallest of another
// index.
struct Nearest {
    int index = -1, best = INT_MAX, second = INT_MAX;

    void offer(int i, int distance) {
        if (i == index) {
            best = std::min(best, distance);
        } else if (distance < best || (distance == best && i < index)) {
            second = best;
            best = distance;
            index = i;
        } else if (distance < second) {
            second = distance;
        }
    }

    bool good(const MatchLimits& limits) const {
        if (index < 0 || best > limits.max_distance) return false;
        return limits.ratio >= 1.0f || second == INT_MAX || best <= limits.ratio * second;
    }
};

// What is farther neither matches nor spoils a match.
int farthest(const MatchLimits& limits) {
    if (!(limits.ratio > 0.0f)) return INT_MAX;
    const float far = static_cast<float>(limits.max_distance) / std::min(limits.ratio, 1.0f) + 1.0f;
    return static_cast<int>(std::min(far, 1e9f));
}

constexpr float kMostCells = 512.0f;  // along either side of the grid

// Train points sorted into square cells at least as wide as the search radius.
class PlaceGrid {
 public:
    PlaceGrid(const Places& places, int count, float radius)
        : places_(places), cell_(std::max(radius, 1.0f)) {
        if (count == 0) return;
        float right = places.xy[0], bottom = places.xy[1];
        left_ = right, top_ = bottom;
        for (int i = 0; i < count; ++i) {
            left_ = std::min(left_, places.xy[2 * i]);
            right = std::max(right, places.xy[2 * i]);
            top_ = std::min(top_, places.xy[2 * i + 1]);
            bottom = std::max(bottom, places.xy[2 * i + 1]);
        }
        // Far-flung points get wider cells instead of more of them.
        cell_ = std::max(cell_, std::max(right - left_, bottom - top_) / kMostCells);
        columns_ = static_cast<int>((right - left_) / cell_) + 1;
        rows_ = static_cast<int>((bottom - top_) / cell_) + 1;
        starts_.assign(static_cast<std::size_t>(columns_) * rows_ + 1, 0);
        for (int i = 0; i < count; ++i) ++starts_[home(i) + 1];
        for (std::size_t k = 1; k < starts_.size(); ++k) starts_[k] += starts_[k - 1];
        std::vector<int> fill(starts_.begin(), starts_.end() - 1);
        members_.resize(count);
        for (int i = 0; i < count; ++i) members_[fill[home(i)]++] = i;
    }

    template <class Visit>
    void around(float x, float y, const Visit& visit) const {
        const int first_row = row_of(y - cell_), last_row = row_of(y + cell_);
        const int first_column = column_of(x - cell_), last_column = column_of(x + cell_);
        for (int row = std::max(first_row, 0); row <= std::min(last_row, rows_ - 1); ++row)
            for (int column = std::max(first_column, 0); column <= std::min(last_column, columns_ - 1);
                 ++column) {
                const std::size_t k = static_cast<std::size_t>(row) * columns_ + column;
                for (int m = starts_[k]; m < starts_[k + 1]; ++m) visit(members_[m]);
            }
    }

 private:
    // Clamped before the cast: a far-away query must not overflow the integer.
    static int cell_index(float offset, float cell) {
        return static_cast<int>(std::floor(std::clamp(offset / cell, -2.0f, 1e8f)));
    }
    int column_of(float x) const { return cell_index(x - left_, cell_); }
    int row_of(float y) const { return cell_index(y - top_, cell_); }
    std::size_t home(int i) const {
        return static_cast<std::size_t>(row_of(places_.xy[2 * i + 1])) * columns_ +
               column_of(places_.xy[2 * i]);
    }

    const Places& places_;
    float cell_, left_ = 0.0f, top_ = 0.0f;
    int columns_ = 0, rows_ = 0;
    std::vector<int> starts_, members_;
};

// Every train descriptor stays with the query nearest to it; the first of equals.
std::vector<std::int32_t> settle(const std::vector<Nearest>& nearest, int train_count,
                                 const MatchLimits& limits) {
    std::vector<std::int32_t> owner(train_count, -1), matches(nearest.size(), -1);
    for (std::size_t q = 0; q < nearest.size(); ++q) {
        if (!nearest[q].good(limits)) continue;
        std::int32_t& holder = owner[nearest[q].index];
        if (holder < 0 || nearest[q].best < nearest[holder].best) holder = static_cast<std::int32_t>(q);
    }
    for (int t = 0; t < train_count; ++t)
        if (owner[t] >= 0) matches[owner[t]] = t;
    return matches;
}

}  // namespace

std::vector<std::int32_t> hamming_distances(const Descriptors& query, const Descriptors& train) {
    std::vector<std::int32_t> all(static_cast<std::size_t>(query.count) * train.count);
    for (int q = 0; q < query.count; ++q)
        distances(query.data + static_cast<std::size_t>(q) * query.bytes, train.data, train.bytes,
                  train.count, all.data() + static_cast<std::size_t>(q) * train.count);
    return all;
}

std::vector<std::int32_t> match_mutual(const Descriptors& query, const Descriptors& train,
                                       const std::int32_t* group, int groups, const MatchLimits& limits) {
    const int far = farthest(limits);
    std::vector<Nearest> forward(query.count), backward(groups);
    std::vector<int> row(train.count);
    for (int q = 0; q < query.count; ++q) {
        distances(query.data + static_cast<std::size_t>(q) * query.bytes, train.data, train.bytes,
                  train.count, row.data());
        for (int t = 0; t < train.count; ++t) {
            if (row[t] > far) continue;
            forward[q].offer(group[t], row[t]);
            backward[group[t]].offer(q, row[t]);
        }
    }
    std::vector<std::int32_t> matches(query.count, -1);
    for (int q = 0; q < query.count; ++q)
        if (forward[q].good(limits) && backward[forward[q].index].index == q) matches[q] = forward[q].index;
    return matches;
}

std::vector<std::int32_t> match_windowed(const Descriptors& query, const Places& query_places,
                                         const Descriptors& train, const Places& train_places, float radius,
                                         const MatchLimits& limits) {
    const PlaceGrid grid(train_places, train.count, radius);
    std::vector<Nearest> nearest(query.count);
    for (int q = 0; q < query.count; ++q) {
        const float x = query_places.xy[2 * q], y = query_places.xy[2 * q + 1];
        grid.around(x, y, [&](int t) {
            const float dx = train_places.xy[2 * t] - x, dy = train_places.xy[2 * t + 1] - y;
            if (train_places.view[t] != query_places.view[q] || dx * dx + dy * dy > radius * radius) return;
            int bits;
            distances(query.data + static_cast<std::size_t>(q) * query.bytes,
                      train.data + static_cast<std::size_t>(t) * train.bytes, train.bytes, 1, &bits);
            nearest[q].offer(t, bits);
        });
    }
    return settle(nearest, train.count, limits);
}

}  // namespace facetcam
