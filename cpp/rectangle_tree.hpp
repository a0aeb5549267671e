// Nearest one-sided rectangle along a ray, by a tree of axis-aligned bounding boxes.
#pragma once
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "vec3.hpp"

namespace facetcam {

// Seen from its front side, `right` and `down` (unit vectors) run along the edges of the picture on it.
struct Rectangle {
    Vec3 corner, right, down;
    float width, height;
};

struct Hit {
    std::int32_t surface = -1;  // index of the rectangle, -1 where the ray meets none
    float distance = std::numeric_limits<float>::infinity();  // along the unit direction
    float u = 0.0f, v = 0.0f;  // place on the rectangle, 0 to 1 from its corner
};

// Holds the least corner of what it includes and the greatest.
struct Box {
    Vec3 low{1e30f, 1e30f, 1e30f}, high{-1e30f, -1e30f, -1e30f};

    Box& include(Vec3 p);
    Box& include(const Box& other);
    float area() const;
};

class RectangleTree {
 public:
    RectangleTree(const Rectangle* rectangles, std::size_t count);
    Hit nearest(Vec3 origin, Vec3 direction) const;

 private:
    // A rectangle with what every ray asks for worked out.
    struct Face {
        Vec3 corner, normal, across, along;  // `across` and `along` measure places from 0 to 1
        Box box;
        Vec3 centre;
        int index;
    };

    struct Node {
        Box box;
        int first, count;  // faces of a leaf; count is 0 in an inner node
        int right, axis;   // the left child is the next node
    };

    struct Split {
        int axis, left;
        float cost;
    };

    void build(int first, int count, int depth);
    void sort_along(int axis, int first, int count);
    Split best_split(int first, int count);
    static void intersect(const Face& face, Vec3 origin, Vec3 direction, Hit& hit);

    std::vector<Face> faces_;
    std::vector<Node> nodes_;
};

}  // namespace facetcam
