// A plain parallel loop: tasks are taken in order, results belong to the task and not to the thread.
#pragma once
#include <functional>

namespace facetcam {

// Runs task(0) to task(count - 1) on up to `threads` threads, this one among them. The others are kept for
// the next call; one that comes late is not waited for, so a busy machine costs little. Tasks must not throw.
void parallel_for(int count, int threads, const std::function<void(int)>& task);

}  // namespace facetcam
