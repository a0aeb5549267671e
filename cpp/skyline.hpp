// Positive definite systems of 6x6 blocks whose rows start at their first filled block.
#pragma once
#include <cstddef>
#include <vector>

namespace facetcam {

// Lower triangle of a symmetric matrix, row by row, each from its first filled block to the diagonal. Frames
// in the order of time see neighbours only, so rows are short until a loop closes.
class Skyline {
 public:
    static constexpr int kBlock = 6;

    // `first[i]` is the first filled block of block row i.
    explicit Skyline(std::vector<int> first);

    int blocks() const { return static_cast<int>(first_.size()); }
    int rows() const { return kBlock * blocks(); }
    int first_block(int block_row) const { return first_[static_cast<std::size_t>(block_row)]; }
    // Entry (row, 0): only columns from `begin(row)` to `row` exist.
    double* row(int row) { return values_.data() + offset_[static_cast<std::size_t>(row)]; }
    const double* row(int row) const { return values_.data() + offset_[static_cast<std::size_t>(row)]; }
    int begin(int row) const { return kBlock * first_block(row / kBlock); }
    void clear();

    // Replaces the matrix by its Cholesky factor; false where it is not positive definite.
    bool factorise();
    // Solves with the factor, in place.
    void solve(double* x) const;

 private:
    std::vector<int> first_;
    std::vector<std::ptrdiff_t> offset_;
    std::vector<double> values_;
};

}  // namespace facetcam
