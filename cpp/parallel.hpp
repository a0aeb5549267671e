// A plain parallel loop: tasks are taken in order, results belong to the task and not to the thread.
#pragma once
#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

namespace facetcam {

template <class Task>
void parallel_for(int count, int threads, const Task& task) {
    std::atomic<int> next{0};
    const auto work = [&] {
        for (int i = next++; i < count; i = next++) task(i);
    };
    std::vector<std::thread> helpers;
    for (int t = 1; t < std::min(threads, count); ++t) helpers.emplace_back(work);
    work();
    for (auto& helper : helpers) helper.join();
}

}  // namespace facetcam
