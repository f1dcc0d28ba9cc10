// How a thread waits for what the network brings.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>

#include <isonest/error.h>

namespace isonest::detail {

/// Each thread gets an error of its own.
[[noreturn]] inline void throw_copy_of(const Error& error) {
    throw Error(error.kind(), error.place(), error.problem(), error.remedies());
}

/// Until is_over(), which is called with the lock held. Meanwhile check() (RemoteOptions) is called
/// every 50 ms, without the lock. Throws what the two throw.
template <class IsOver>
void wait_and_check(std::unique_lock<std::mutex>& lock, std::condition_variable& changed,
                    const std::function<void()>& check, const IsOver& is_over) {
    constexpr std::chrono::milliseconds kCheckEvery{50};
    auto next_check = std::chrono::steady_clock::now() + kCheckEvery;
    while (!is_over()) {
        changed.wait_until(lock, next_check);
        if (std::chrono::steady_clock::now() >= next_check) {
            next_check = std::chrono::steady_clock::now() + kCheckEvery;
            if (check) {
                lock.unlock();
                check();
                lock.lock();
            }
        }
    }
}

}  // namespace isonest::detail
