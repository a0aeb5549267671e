#include "rectangle_tree.hpp"

#include <cmath>

namespace facetcam {
namespace {

constexpr int kFacesPerLeaf = 3;
constexpr int kDeepest = 32;  // from here on halves, so that the stack cannot overflow
constexpr int kStackSize = 64;
constexpr float kPadding = 1e-5f;  // metres; a flat box would be missed by rounding
constexpr float kStart = 1e-5f;    // metres; nearer hits are the surface that the ray leaves

// A direction along a coordinate plane must not turn 0 * inf into NaN.
float reciprocal(float d) { return 1.0f / (std::abs(d) < 1e-20f ? 1e-20f : d); }

bool meets(const Box& box, Vec3 origin, Vec3 inverse, float distance) {
    const Vec3 t0 = (box.low - origin) * inverse, t1 = (box.high - origin) * inverse;
    const Vec3 in = smaller(t0, t1), out = larger(t0, t1);
    const float enter = std::max(std::max(in.x, in.y), std::max(in.z, 0.0f));
    return enter <= std::min(std::min(out.x, out.y), std::min(out.z, distance));
}

Box padded_box(const Rectangle& r) {
    const Vec3 padding = {kPadding, kPadding, kPadding};
    Box box;
    for (const float u : {0.0f, r.width})
        for (const float v : {0.0f, r.height}) box.include(r.corner + r.right * u + r.down * v);
    return {box.low - padding, box.high + padding};
}

}  // namespace

Box& Box::include(Vec3 p) {
    low = smaller(low, p);
    high = larger(high, p);
    return *this;
}

Box& Box::include(const Box& other) { return include(other.low).include(other.high); }

float Box::area() const {
    const Vec3 d = high - low;
    return d.x * d.y + d.y * d.z + d.z * d.x;
}

RectangleTree::RectangleTree(const Rectangle* rectangles, std::size_t count) {
    faces_.reserve(count);
    for (std::size_t i = 0; i < count; ++i) {
        const Rectangle& r = rectangles[i];
        const Vec3 centre = r.corner + r.right * (0.5f * r.width) + r.down * (0.5f * r.height);
        faces_.push_back({r.corner, cross(r.down, r.right), r.right * (1.0f / r.width),
                          r.down * (1.0f / r.height), padded_box(r), centre, static_cast<int>(i)});
    }
    if (count > 0) build(0, static_cast<int>(count), 0);
}

Hit RectangleTree::nearest(Vec3 origin, Vec3 direction) const {
    Hit hit;
    const Vec3 inverse = {reciprocal(direction.x), reciprocal(direction.y), reciprocal(direction.z)};
    int stack[kStackSize], top = 0;
    if (!nodes_.empty()) stack[top++] = 0;
    while (top > 0) {
        const int index = stack[--top];
        const Node& node = nodes_[index];
        if (!meets(node.box, origin, inverse, hit.distance)) continue;
        for (int i = node.first; i < node.first + node.count; ++i)
            intersect(faces_[i], origin, direction, hit);
        if (node.count > 0) continue;
        const bool from_right = component(direction, node.axis) < 0.0f;  // nearer child last, taken first
        stack[top++] = from_right ? index + 1 : node.right;
        stack[top++] = from_right ? node.right : index + 1;
    }
    return hit;
}

void RectangleTree::intersect(const Face& face, Vec3 origin, Vec3 direction, Hit& hit) {
    const float slope = dot(direction, face.normal);
    if (slope >= 0.0f) return;  // seen from behind
    const float t = dot(face.corner - origin, face.normal) / slope;
    if (!(t > kStart && t < hit.distance)) return;
    const Vec3 p = origin + direction * t - face.corner;
    const float u = dot(p, face.across), v = dot(p, face.along);
    if (u >= 0.0f && u <= 1.0f && v >= 0.0f && v <= 1.0f) hit = {face.index, t, u, v};
}

void RectangleTree::build(int first, int count, int depth) {
    const int index = static_cast<int>(nodes_.size());
    Box box;
    for (int i = first; i < first + count; ++i) box.include(faces_[i].box);
    nodes_.push_back({box, first, count, 0, 0});
    if (count <= kFacesPerLeaf) return;
    const Split split = depth < kDeepest ? best_split(first, count) : Split{0, count / 2, 0.0f};
    sort_along(split.axis, first, count);
    nodes_[index].count = 0;
    nodes_[index].axis = split.axis;
    build(first, split.left, depth + 1);
    nodes_[index].right = static_cast<int>(nodes_.size());
    build(first + split.left, count - split.left, depth + 1);
}

void RectangleTree::sort_along(int axis, int first, int count) {
    const auto begin = faces_.begin() + first;
    std::sort(begin, begin + count, [axis](const Face& a, const Face& b) {
        const float x = component(a.centre, axis), y = component(b.centre, axis);
        return x != y ? x < y : a.index < b.index;
    });
}

// Surface-area heuristic: a ray meets a box in proportion to its area.
RectangleTree::Split RectangleTree::best_split(int first, int count) {
    Split best = {0, count / 2, std::numeric_limits<float>::infinity()};
    std::vector<float> left_area(count);
    for (int axis = 0; axis < 3; ++axis) {
        sort_along(axis, first, count);
        Box left, right;
        for (int i = 0; i < count; ++i) left_area[i] = left.include(faces_[first + i].box).area();
        for (int i = count - 1; i > 0; --i) {
            const float area = right.include(faces_[first + i].box).area();
            const float cost = left_area[i - 1] * i + area * (count - i);
            if (cost < best.cost) best = {axis, i, cost};
        }
    }
    return best;
}

}  // namespace facetcam
