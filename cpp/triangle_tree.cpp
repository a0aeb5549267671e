#include "triangle_tree.hpp"

#include <cmath>

namespace facetcam {
namespace {

constexpr int kFacesPerLeaf = 3;
constexpr int kBins = 16;
constexpr int kDeepest = 32;  // from here on halves, so that the stack cannot overflow
constexpr int kStackSize = 64;
constexpr float kPadding = 1e-5f;  // metres; a flat box would be missed by rounding
constexpr float kSlack = 1e-6f;    // share of an edge; no ray slips between two triangles

// A direction along a coordinate plane must not turn 0 * inf into NaN.
float reciprocal(float d) { return 1.0f / (std::abs(d) < 1e-20f ? 1e-20f : d); }

bool meets(const Box& box, Vec3 origin, Vec3 inverse, float distance) {
    const Vec3 t0 = (box.low - origin) * inverse, t1 = (box.high - origin) * inverse;
    const Vec3 in = smaller(t0, t1), out = larger(t0, t1);
    const float enter = std::max(std::max(in.x, in.y), std::max(in.z, 0.0f));
    return enter <= std::min(std::min(out.x, out.y), std::min(out.z, distance));
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

Box TriangleTree::Face::box() const {
    const Vec3 padding = {kPadding, kPadding, kPadding};
    Box box;
    box.include(corner).include(corner + right).include(corner + left);
    return {box.low - padding, box.high + padding};
}

TriangleTree::TriangleTree(const Vec3* vertices, const std::int32_t (*corners)[3], std::size_t count) {
    faces_.reserve(count);
    for (std::size_t i = 0; i < count; ++i) {
        const Vec3 a = vertices[corners[i][0]];
        faces_.push_back(
            {a, vertices[corners[i][1]] - a, vertices[corners[i][2]] - a, static_cast<std::int32_t>(i)});
    }
    if (count > 0) build(0, static_cast<int>(count), 0);
}

Hit TriangleTree::nearest(Vec3 origin, Vec3 direction) const {
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

// Moeller and Trumbore (1997).
void TriangleTree::intersect(const Face& face, Vec3 origin, Vec3 direction, Hit& hit) {
    const Vec3 p = cross(direction, face.left);
    const float scale = 1.0f / dot(face.right, p);  // infinite along the plane: no comparison holds
    const Vec3 s = origin - face.corner, q = cross(s, face.right);
    const float u = dot(s, p) * scale, v = dot(direction, q) * scale, t = dot(face.left, q) * scale;
    if (u >= -kSlack && v >= -kSlack && u + v <= 1.0f + kSlack && t > 0.0f && t < hit.distance)
        hit = {face.index, t, u, v};
}

void TriangleTree::build(int first, int count, int depth) {
    const int index = static_cast<int>(nodes_.size());
    Box box, centres;
    for (int i = first; i < first + count; ++i) {
        box.include(faces_[i].box());
        centres.include(faces_[i].centre());
    }
    nodes_.push_back({box, first, count, 0, 0});
    if (count <= kFacesPerLeaf) return;
    const Vec3 wide = centres.high - centres.low;
    const int axis = wide.x >= wide.y && wide.x >= wide.z ? 0 : wide.y >= wide.z ? 1 : 2;
    int left = depth < kDeepest ? split(first, count, axis, centres) : 0;
    if (left == 0 || left == count) {
        left = count / 2;
        const auto begin = faces_.begin() + first;
        std::nth_element(begin, begin + left, begin + count, [axis](const Face& a, const Face& b) {
            return component(a.centre(), axis) < component(b.centre(), axis);
        });
    }
    nodes_[index].count = 0;
    nodes_[index].axis = axis;
    build(first, left, depth + 1);
    nodes_[index].right = static_cast<int>(nodes_.size());
    build(first + left, count - left, depth + 1);
}

// Surface-area heuristic over bins: a ray meets a box in proportion to its area. Returns how many faces go
// left.
int TriangleTree::split(int first, int count, int axis, const Box& centres) {
    const float low = component(centres.low, axis), width = component(centres.high, axis) - low;
    if (!(width > 0.0f)) return 0;
    const auto bin_of = [=](const Face& face) {
        return std::min(kBins - 1, static_cast<int>((component(face.centre(), axis) - low) / width * kBins));
    };
    Box boxes[kBins];
    int counts[kBins] = {};
    for (int i = first; i < first + count; ++i) {
        boxes[bin_of(faces_[i])].include(faces_[i].box());
        ++counts[bin_of(faces_[i])];
    }
    float left_cost[kBins] = {};
    Box box;
    for (int bin = 0, below = 0; bin < kBins - 1; ++bin) {
        below += counts[bin];
        if (below > 0) left_cost[bin] = box.include(boxes[bin]).area() * below;
    }
    float least = std::numeric_limits<float>::infinity();
    int border = 0;
    box = {};
    for (int bin = kBins - 1, above = 0; bin > 0; --bin) {
        above += counts[bin];
        if (above == 0 || above == count) continue;
        const float cost = left_cost[bin - 1] + box.include(boxes[bin]).area() * above;
        if (cost < least) least = cost, border = bin;
    }
    const auto begin = faces_.begin() + first;
    const auto middle =
        std::partition(begin, begin + count, [&](const Face& face) { return bin_of(face) < border; });
    return static_cast<int>(middle - begin);
}

}  // namespace facetcam
