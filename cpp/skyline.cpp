#include "skyline.hpp"

#include <algorithm>
#include <cmath>

namespace facetcam {

namespace {

double dot(const double* a, const double* b, int n) {
    double sum = 0;
#pragma omp simd reduction(+ : sum)
    for (int i = 0; i < n; ++i) sum += a[i] * b[i];
    return sum;
}

}  // namespace

Skyline::Skyline(std::vector<int> first) : first_(std::move(first)) {
    std::ptrdiff_t used = 0;
    for (int r = 0; r < rows(); ++r) {
        offset_.push_back(used - begin(r));
        used += kBlock * (r / kBlock + 1) - begin(r);
    }
    values_.resize(static_cast<std::size_t>(used));
}

void Skyline::clear() { std::fill(values_.begin(), values_.end(), 0.0); }

bool Skyline::factorise() {
    for (int i = 0; i < rows(); ++i) {
        double* a = row(i);
        for (int j = begin(i); j <= i; ++j) {
            const double* b = row(j);
            const int from = std::max(begin(i), begin(j));
            const double rest = a[j] - dot(a + from, b + from, j - from);
            if (j < i) {
                a[j] = rest / b[j];
            } else {
                if (!(rest > 0.0) || !std::isfinite(rest)) return false;
                a[i] = std::sqrt(rest);
            }
        }
    }
    return true;
}

void Skyline::solve(double* x) const {
    for (int i = 0; i < rows(); ++i) {
        const double* a = row(i);
        x[i] = (x[i] - dot(a + begin(i), x + begin(i), i - begin(i))) / a[i];
    }
    for (int i = rows() - 1; i >= 0; --i) {
        const double* a = row(i);
        x[i] /= a[i];
        for (int j = begin(i); j < i; ++j) x[j] -= x[i] * a[j];
    }
}

}  // namespace facetcam
