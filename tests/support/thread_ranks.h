// Ranks that are threads of one process, for tests of code on several ranks.
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/ranks/communicator.h"

namespace isonest::test {

/// State shared by all ranks.
class ThreadRanks {
  public:
    explicit ThreadRanks(int size) : size_(size) {}

    /// Runs `work` on all ranks at once. Throws what the first failing rank threw.
    void run(const std::function<void(detail::Communicator&)>& work) {
        std::vector<std::thread> threads;
        for (int r = 0; r < size_; ++r) {
            threads.emplace_back([this, r, &work] {
                Rank rank(*this, r);
                try {
                    work(rank);
                } catch (...) {
                    const std::lock_guard lock(mutex_);
                    failure_ = failure_ ? failure_ : std::current_exception();
                    changed_.notify_all();
                }
            });
        }
        for (std::thread& thread : threads) {
            thread.join();
        }
        if (failure_) {
            std::rethrow_exception(failure_);
        }
    }

  private:
    class Rank : public detail::Communicator {
      public:
        Rank(ThreadRanks& all, int number) : all_(all), number_(number) {}
        [[nodiscard]] int rank() const override { return number_; }
        [[nodiscard]] int size() const override { return all_.size_; }
        [[nodiscard]] std::string host() const override { return "thread"; }
        void exchange(const Next& next, std::uint64_t expected, const Take& take) override {
            ++exchanges_;
            for (Message message; next(message); message = {}) {
                if (message.to == number_ || message.to < 0 || message.to >= size() ||
                    message.bytes.size() > kMaxBytes) {
                    throw std::logic_error("a message that no rank may send");
                }
                ++traffic_.messages_sent;
                traffic_.bytes_sent += message.bytes.size();
                const std::lock_guard lock(all_.mutex_);
                all_.boxes_[{message.to, exchanges_}].emplace_back(number_,
                                                                   std::move(message.bytes));
                all_.changed_.notify_all();
            }
            for (std::uint64_t i = 0; i < expected; ++i) {
                std::unique_lock lock(all_.mutex_);
                auto& box = all_.boxes_[{number_, exchanges_}];
                all_.changed_.wait(lock, [&] { return all_.failure_ || !box.empty(); });
                if (all_.failure_) {
                    throw Error(ErrorKind::cancelled, "another rank has failed");
                }
                const auto [from, bytes] = std::move(box.front());
                box.pop_front();
                lock.unlock();
                ++traffic_.messages_received;
                traffic_.bytes_received += bytes.size();
                take(from, bytes);
            }
        }
        void check() override {
            const std::lock_guard lock(all_.mutex_);
            if (all_.failure_) {
                throw Error(ErrorKind::cancelled, "another rank has failed");
            }
        }

      private:
        ThreadRanks& all_;
        int number_;
        std::uint64_t exchanges_ = 0;
    };

    int size_;
    std::mutex mutex_;
    std::condition_variable changed_;
    std::exception_ptr failure_;
    /// Messages to a rank in one exchange, with their senders.
    std::map<std::pair<int, std::uint64_t>, std::deque<std::pair<int, std::vector<std::byte>>>>
        boxes_;
};

}  // namespace isonest::test
