#include "parallel.hpp"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <thread>

namespace facetcam {

namespace {

class Job {
 public:
    Job(int count, const std::function<void(int)>& task) : count_(count), task_(task) {}

    void work() {
        int done = 0;
        for (int i = next_++; i < count_; i = next_++, ++done) task_(i);
        if (done == 0) return;
        const std::lock_guard<std::mutex> lock(mutex_);
        finished_ += done;
        if (finished_ == count_) all_finished_.notify_one();
    }

    void wait() {
        std::unique_lock<std::mutex> lock(mutex_);
        all_finished_.wait(lock, [this] { return finished_ == count_; });
    }

 private:
    const int count_;
    const std::function<void(int)>& task_;  // gone once all tasks are finished, and not called after
    std::atomic<int> next_{0};
    int finished_ = 0;
    std::mutex mutex_;
    std::condition_variable all_finished_;
};

class Helpers {
 public:
    void call(const std::shared_ptr<Job>& job, int wanted) {
        const std::lock_guard<std::mutex> lock(mutex_);
        for (; threads_ < wanted; ++threads_) std::thread(&Helpers::serve, this).detach();
        for (int i = 0; i < wanted; ++i) {
            jobs_.push_back(job);
            called_.notify_one();
        }
    }

    // Forgets calls that no thread has answered: none may be left after a fork.
    void dismiss(const std::shared_ptr<Job>& job) {
        const std::lock_guard<std::mutex> lock(mutex_);
        jobs_.erase(std::remove(jobs_.begin(), jobs_.end(), job), jobs_.end());
    }

 private:
    void serve() {
        for (;;) {
            std::unique_lock<std::mutex> lock(mutex_);
            called_.wait(lock, [this] { return !jobs_.empty(); });
            const std::shared_ptr<Job> job = jobs_.front();
            jobs_.pop_front();
            lock.unlock();
            job->work();
        }
    }

    std::mutex mutex_;
    std::condition_variable called_;
    std::deque<std::shared_ptr<Job>> jobs_;
    int threads_ = 0;
};

Helpers& helpers() {
    static Helpers* instance =
        new Helpers;  // never destroyed: its threads sleep in it until the process ends
    return *instance;
}

}  // namespace

void parallel_for(int count, int threads, const std::function<void(int)>& task) {
    const int wanted = std::min(threads, count) - 1;
    if (wanted < 1) {
        for (int i = 0; i < count; ++i) task(i);
        return;
    }
    const auto job = std::make_shared<Job>(count, task);
    helpers().call(job, wanted);
    job->work();
    helpers().dismiss(job);
    job->wait();
}

}  // namespace facetcam
