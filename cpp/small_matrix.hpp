// Matrices of a few rows and columns whose sizes are known to the compiler, and rigid motions made of them.
#pragma once
#include <array>
#include <cmath>

namespace facetcam {

template <int Rows, int Columns>
struct Mat {
    std::array<double, static_cast<std::size_t>(Rows* Columns)> v{};

    double& operator()(int i, int j) { return v[static_cast<std::size_t>(i * Columns + j)]; }
    double operator()(int i, int j) const { return v[static_cast<std::size_t>(i * Columns + j)]; }
    double& operator[](int i) { return v[static_cast<std::size_t>(i)]; }
    double operator[](int i) const { return v[static_cast<std::size_t>(i)]; }

    Mat& operator+=(const Mat& b) {
        for (int i = 0; i < Rows * Columns; ++i) (*this)[i] += b[i];
        return *this;
    }
    Mat& operator-=(const Mat& b) {
        for (int i = 0; i < Rows * Columns; ++i) (*this)[i] -= b[i];
        return *this;
    }
    Mat& operator*=(double s) {
        for (int i = 0; i < Rows * Columns; ++i) (*this)[i] *= s;
        return *this;
    }
};

template <int N>
using Vec = Mat<N, 1>;

template <int R, int C>
Mat<R, C> operator+(Mat<R, C> a, const Mat<R, C>& b) {
    return a += b;
}
template <int R, int C>
Mat<R, C> operator-(Mat<R, C> a, const Mat<R, C>& b) {
    return a -= b;
}
template <int R, int C>
Mat<R, C> operator*(double s, Mat<R, C> a) {
    return a *= s;
}
template <int R, int N, int C>
Mat<R, C> operator*(const Mat<R, N>& a, const Mat<N, C>& b) {
    Mat<R, C> out;
    for (int i = 0; i < R; ++i)
        for (int k = 0; k < N; ++k)
            for (int j = 0; j < C; ++j) out(i, j) += a(i, k) * b(k, j);
    return out;
}
// a' * b
template <int R, int N, int C>
Mat<R, C> transposed_times(const Mat<N, R>& a, const Mat<N, C>& b) {
    Mat<R, C> out;
    for (int k = 0; k < N; ++k)
        for (int i = 0; i < R; ++i)
            for (int j = 0; j < C; ++j) out(i, j) += a(k, i) * b(k, j);
    return out;
}
template <int R, int C>
Mat<C, R> transposed(const Mat<R, C>& a) {
    Mat<C, R> out;
    for (int i = 0; i < R; ++i)
        for (int j = 0; j < C; ++j) out(j, i) = a(i, j);
    return out;
}
template <int N>
double dot(const Vec<N>& a, const Vec<N>& b) {
    double sum = 0;
    for (int i = 0; i < N; ++i) sum += a[i] * b[i];
    return sum;
}
template <int N>
Mat<N, N> identity() {
    Mat<N, N> out;
    for (int i = 0; i < N; ++i) out(i, i) = 1.0;
    return out;
}

using Mat3 = Mat<3, 3>;
using Vec3d = Vec<3>;

inline Mat3 skew(const Vec3d& a) { return {{0, -a[2], a[1], a[2], 0, -a[0], -a[1], a[0], 0}}; }

// Inverse of a symmetric positive definite matrix.
inline Mat3 inverse_symmetric(const Mat3& m) {
    const double a = m(0, 0), b = m(0, 1), c = m(0, 2), d = m(1, 1), e = m(1, 2), f = m(2, 2);
    const double A = d * f - e * e, B = c * e - b * f, C = b * e - c * d;
    const double s = 1.0 / (a * A + b * B + c * C);
    const double D = a * f - c * c, E = b * c - a * e, F = a * d - b * b;
    return {{s * A, s * B, s * C, s * B, s * D, s * E, s * C, s * E, s * F}};
}

// Rotation by a vector (Rodrigues).
inline Mat3 rotation(const Vec3d& w) {
    const double angle2 = dot(w, w), angle = std::sqrt(angle2);
    const double a = angle < 1e-4 ? 1.0 - angle2 / 6.0 : std::sin(angle) / angle;
    const double b = angle < 1e-4 ? 0.5 - angle2 / 24.0 : (1.0 - std::cos(angle)) / angle2;
    const Mat3 K = skew(w);
    return identity<3>() + a * K + b * (K * K);
}

// Vector of a rotation below pi, by way of its quaternion, which is exact for small and for large angles.
inline Vec3d rotation_vector(const Mat3& R) {
    Vec3d axis{{R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1)}};
    const double twice_sin = std::sqrt(dot(axis, axis)), twice_cos = R(0, 0) + R(1, 1) + R(2, 2) - 1.0;
    const double angle = std::atan2(twice_sin, twice_cos);
    return (twice_sin < 1e-7 ? 0.5 : angle / twice_sin) * axis;
}

// d rotation_vector(R exp(w)) / d w at w = 0, for R of the vector `phi`.
inline Mat3 inverse_right_jacobian(const Vec3d& phi) {
    const double angle2 = dot(phi, phi), angle = std::sqrt(angle2);
    const double c =
        angle < 1e-3 ? 1.0 / 12.0 : 1.0 / angle2 - (1.0 + std::cos(angle)) / (2.0 * angle * std::sin(angle));
    const Mat3 K = skew(phi);
    return identity<3>() + 0.5 * K + c * (K * K);
}

// A proper rigid motion: x -> R x + t.
struct Rigid {
    Mat3 R = identity<3>();
    Vec3d t;

    Vec3d operator*(const Vec3d& x) const { return R * x + t; }
    Rigid operator*(const Rigid& b) const { return {R * b.R, R * b.t + t}; }
    Rigid inverse() const {
        const Mat3 back = transposed(R);
        return {back, -1.0 * (back * t)};
    }
    // Moved by a small rotation and translation in its own frame.
    Rigid moved(const Vec<6>& twist) const {
        const Vec3d w{{twist[0], twist[1], twist[2]}}, v{{twist[3], twist[4], twist[5]}};
        return {R * rotation(w), t + R * v};
    }
};

// The motion with the rows of its rotation at unit length and at right angles again (Gram-Schmidt): sums of
// small turns drift by rounding.
inline Rigid orthonormal(Rigid T) {
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < i; ++k) {
            double along = 0;
            for (int j = 0; j < 3; ++j) along += T.R(i, j) * T.R(k, j);
            for (int j = 0; j < 3; ++j) T.R(i, j) -= along * T.R(k, j);
        }
        double length2 = 0;
        for (int j = 0; j < 3; ++j) length2 += T.R(i, j) * T.R(i, j);
        for (int j = 0; j < 3; ++j) T.R(i, j) /= std::sqrt(length2);
    }
    return T;
}

}  // namespace facetcam
