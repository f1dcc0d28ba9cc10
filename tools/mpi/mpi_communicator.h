// The ranks of an MPI run. MPI transports the messages; its launcher starts and ends the ranks.
#pragma once

#include <mpi.h>

#include <atomic>
#include <chrono>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "store/ranks/communicator.h"

namespace isonest::detail {

/// All ranks of MPI_COMM_WORLD. Waiting takes no processor time, so there may be more ranks than
/// cores. Thread-safety: as for Communicator.
class MpiCommunicator : public Communicator {
  public:
    /// `stop`: whether the user wants the run to end; called while the rank waits.
    MpiCommunicator(int& argc, char**& argv, std::function<bool()> stop);
    MpiCommunicator(const MpiCommunicator&) = delete;
    MpiCommunicator& operator=(const MpiCommunicator&) = delete;
    ~MpiCommunicator() override;  ///< REQUIRES: all ranks have agreed.

    [[nodiscard]] int rank() const override { return rank_; }
    [[nodiscard]] int size() const override { return size_; }
    [[nodiscard]] std::string host() const override { return host_; }
    void exchange(const Next& next, std::uint64_t expected, const Take& take) override;
    void check() override;
    void ignore_stop(bool is_ignored) override { is_stop_ignored_ = is_ignored; }

    /// How the run ended on one rank.
    struct Ending {
        int exit_code = 0;
        std::string message = {};     ///< why it failed; empty if it did not
        std::string details = {};     ///< the same, machine-readable
        bool is_consequence = false;  ///< it ended because another rank had failed
        [[nodiscard]] bool has_failed() const { return !message.empty(); }
    };
    /// Called once by every rank, when it is done or has failed. Other ranks that are still working
    /// learn of a failure in check() or exchange(). Returns when all ranks have called it, with the
    /// ending that counts: that of the first rank that failed by itself; `who` is its number.
    Ending agree(const Ending& own, int& who);

  private:
    struct Sending {
        std::vector<std::byte> bytes;
        MPI_Request request = MPI_REQUEST_NULL;
    };
    /// Whether a rank has failed; does not throw.
    bool has_failed();
    void require_going_on();
    bool finish_sending();
    void drop_messages();
    Ending gather_endings(const Ending& own, int& who);

    const std::function<bool()> stop_;
    int rank_ = 0;
    int size_ = 1;
    std::string host_;
    std::mutex mutex_;  ///< guards all MPI calls
    std::deque<Sending> sending_;
    std::uint64_t exchanges_ = 0;
    std::atomic<bool> failed_ = false;
    bool is_stop_ignored_ = false;
    std::atomic<std::chrono::steady_clock::rep> next_look_ = 0;
};

}  // namespace isonest::detail
