// Corners and matching on images and descriptors of random sizes, strides and values; run under the
// sanitizers.
#include <cstdio>
#include <random>

#include "corners.hpp"
#include "matching.hpp"

using namespace facetcam;

namespace {

std::mt19937 rng(1);

int up_to(int low, int high) { return std::uniform_int_distribution<int>(low, high)(rng); }
float between(float low, float high) { return std::uniform_real_distribution<float>(low, high)(rng); }

template <class Pixel>
void fuzz_image(PixelType type) {
    const int width = up_to(1, 120), height = up_to(1, 120), step = up_to(1, 3),
              stride = width * step + up_to(0, 5);
    // Exactly as many pixels as the view reaches: one read too far is an error.
    std::vector<Pixel> pixels(static_cast<std::size_t>(height - 1) * stride + (width - 1) * step + 1);
    const int top = up_to(0, 255);
    for (auto& pixel : pixels) pixel = static_cast<Pixel>(up_to(0, top));
    const std::ptrdiff_t bytes = sizeof(Pixel);
    ImageView image{pixels.data(), type, width, height, stride * bytes, step * bytes};
    if (up_to(0, 1)) {  // upside down
        image.data = pixels.data() + static_cast<std::size_t>(height - 1) * stride;
        image.row_stride = -image.row_stride;
    }
    std::vector<std::uint8_t> mask_pixels(static_cast<std::size_t>(width) * height);
    for (auto& pixel : mask_pixels) pixel = static_cast<std::uint8_t>(up_to(0, 1));
    const MaskView mask{up_to(0, 1) ? mask_pixels.data() : nullptr, width, 1};
    const float eta = between(1.0f, 200.0f);
    const auto table = type == PixelType::values ? std::vector<std::int16_t>()
                                                 : log_table(type, measure_light(image, mask), eta);
    const ResponseOptions response{between(0.3f, 4.0f), between(0.85f, 4.0f), between(0.0f, 0.2f),
                                   between(0.0f, 1.0f), between(0.0f, 2.0f)};
    const DetectorOptions options{up_to(1, 7),
                                  response,
                                  {between(0.0f, 0.05f), up_to(1, 8), up_to(0, 20)},
                                  up_to(0, 300),
                                  up_to(0, 30),
                                  up_to(0, 1) == 1,
                                  up_to(1, 4),
                                  static_cast<Isa>(up_to(0, 2))};
    for (const Keypoint& k : detect_corners(image, mask, table, options))
        if (!(k.x >= 0 && k.y >= 0 && k.x <= width - 1 && k.y <= height - 1)) std::abort();
}

void fuzz_matching() {
    const int bytes = up_to(1, 70), n = up_to(0, 60), m = up_to(0, 60);
    const auto random_bytes = [&](int count) {
        std::vector<std::uint8_t> data(static_cast<std::size_t>(count) * bytes);
        for (auto& value : data) value = static_cast<std::uint8_t>(up_to(0, 255));
        return data;
    };
    const auto random_places = [&](int count) {
        std::vector<float> xy(2 * count);
        for (auto& value : xy) value = up_to(0, 20) ? between(-50.0f, 500.0f) : between(-1e9f, 1e9f);
        return xy;
    };
    const auto query = random_bytes(n), train = random_bytes(m);
    const auto query_xy = random_places(n), train_xy = random_places(m);
    std::vector<std::int32_t> query_view(n), train_view(m);
    for (auto& value : query_view) value = up_to(-1, 2);
    for (auto& value : train_view) value = up_to(-1, 2);
    const Descriptors q{query.data(), n, bytes}, t{train.data(), m, bytes};
    const MatchLimits limits{up_to(0, 8 * bytes), between(0.5f, 1.1f)};
    const int groups = up_to(1, 40);
    std::vector<std::int32_t> group(m);
    for (auto& value : group) value = up_to(0, groups - 1);
    match_mutual(q, t, group.data(), groups, limits);
    hamming_distances(q, t);
    match_windowed(q, {query_xy.data(), query_view.data()}, t, {train_xy.data(), train_view.data()},
                   between(0.0f, 200.0f), limits);
}

}  // namespace

int main() {
    for (int round = 0; round < 200; ++round) {
        fuzz_image<std::uint8_t>(PixelType::u8);
        fuzz_image<std::uint16_t>(PixelType::u16);
        fuzz_image<std::int16_t>(PixelType::values);
        fuzz_matching();
    }
    std::puts("no finding");
}
