// Nearest triangle along a ray, on either side, by a tree of axis-aligned bounding boxes.
#pragma once
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "vec3.hpp"

namespace facetcam {

struct Hit {
    std::int32_t surface = -1;  // index of the triangle, -1 where the ray meets none
    float distance = std::numeric_limits<float>::infinity();  // along the unit direction
    float u = 0.0f, v = 0.0f;                                 // shares of the second and third corner
};

// Holds the least corner of what it includes and the greatest.
struct Box {
    Vec3 low{1e30f, 1e30f, 1e30f}, high{-1e30f, -1e30f, -1e30f};

    Box& include(Vec3 p);
    Box& include(const Box& other);
    float area() const;
};

class TriangleTree {
 public:
    // `corners` holds the places of three vertices for each triangle, which must exist.
    TriangleTree(const Vec3* vertices, const std::int32_t (*corners)[3], std::size_t count);
    Hit nearest(Vec3 origin, Vec3 direction) const;

 private:
    struct Face {
        Vec3 corner, right, left;  // first corner, edges to the second and third
        std::int32_t index;

        Vec3 centre() const { return corner + (right + left) * (1.0f / 3.0f); }
        Box box() const;
    };

    struct Node {
        Box box;
        std::int32_t first, count;  // faces of a leaf; count is 0 in an inner node
        std::int32_t right, axis;   // the left child is the next node
    };

    void build(int first, int count, int depth);
    int split(int first, int count, int axis, const Box& centres);
    static void intersect(const Face& face, Vec3 origin, Vec3 direction, Hit& hit);

    std::vector<Face> faces_;
    std::vector<Node> nodes_;
};

}  // namespace facetcam
