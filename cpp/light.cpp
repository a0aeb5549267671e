#include "light.hpp"

#include <algorithm>
#include <cmath>

namespace facetcam {
namespace {

constexpr double kMedianValue = 64.0;  // where the median comes to lie before the logarithm
constexpr double kMiddle = 1.7;        // of all values, above that of the black level

constexpr int kLanes = 4;  // interleaved histograms: runs of equal pixels do not wait for each other

// Indices that are sampled: every `step`-th, counted from both ends, so that a flipped image has the same
// ones.
std::vector<int> sampled(int size, int step) {
    std::vector<int> indices;
    for (int i = 0; i < size; ++i)
        if (std::min(i, size - 1 - i) % step == 0) indices.push_back(i);
    return indices;
}

template <class Pixel>
std::vector<std::uint32_t> histogram(const ImageView& image, const MaskView& mask) {
    const std::size_t bins = std::size_t{1} << (8 * sizeof(Pixel));
    std::vector<std::uint32_t> lanes(kLanes * bins), counts(bins);
    const int step = std::clamp(std::min(image.width, image.height) / 256, 1, 4);
    const std::vector<int> columns = sampled(image.width, step);
    for (int y : sampled(image.height, step)) {
        const char* row = static_cast<const char*>(image.data) + y * image.row_stride;
        int lane = 0;
        for (int x : columns) {
            if (!mask.at(x, y)) continue;
            ++lanes[kLanes * *reinterpret_cast<const Pixel*>(row + x * image.column_stride) + lane];
            lane = (lane + 1) % kLanes;
        }
    }
    for (std::size_t i = 0; i < bins * kLanes; ++i) counts[i / kLanes] += lanes[i];
    return counts;
}

// Quantile with linear interpolation inside the bin, so that it moves smoothly with the image.
double quantile(const std::vector<std::uint32_t>& counts, double share) {
    double total = 0.0, seen = 0.0;
    for (auto c : counts) total += c;
    const double wanted = share * total;
    for (std::size_t i = 0; i < counts.size(); ++i) {
        if (counts[i] && seen + counts[i] >= wanted) return i - 0.5 + (wanted - seen) / counts[i];
        seen += counts[i];
    }
    return 0.0;
}

}  // namespace

LightLevels measure_light(const ImageView& image, const MaskView& mask) {
    const auto counts = image.type == PixelType::u8 ? histogram<std::uint8_t>(image, mask)
                                                    : histogram<std::uint16_t>(image, mask);
    return {quantile(counts, 0.01), quantile(counts, 0.5)};
}

std::vector<std::int16_t> log_table(PixelType type, const LightLevels& light, double eta) {
    const double unit = type == PixelType::u8 ? 1.0 : 257.0;  // one grey step of an 8 bit image
    const double gain = kMedianValue / (light.median - light.black + unit);
    const double slope = 0.5 * (1.0 + eta / kMedianValue);
    const double middle = slope * std::log(eta / (kMedianValue + eta)) + kMiddle;
    std::vector<std::int16_t> table(type == PixelType::u8 ? 256 : 65536);
    for (std::size_t i = 0; i < table.size(); ++i) {
        const double lit = std::max(gain * (static_cast<double>(i) - light.black), 1.0 - eta) + eta;
        const double value = kValueUnit * (slope * std::log(lit / (kMedianValue + eta)) - middle);
        table[i] = static_cast<std::int16_t>(
            std::lround(std::clamp(value, double{-kLargestStep}, double{kLargestStep})));
    }
    return table;
}

}  // namespace facetcam
