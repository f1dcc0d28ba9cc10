// Ranks of an MPI run. MPI carries the messages, its launcher starts the ranks and ends them.
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

/// All ranks of MPI_COMM_WORLD. Waiting costs no processor time, so that there may be more ranks
/// than cores. Thread-safety: as Communicator.
class MpiCommunicator : public Communicator {
  public:
    /// `stop`: whether the user wants the run to end; asked while the rank waits.
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

    /// How the run has ended for one rank.
    struct Ending {
        int exit_code = 0;
        std::string message = {};     ///< why it failed; nothing where it did not
        std::string details = {};     ///< the same for programs
        bool is_consequence = false;  ///< it ended because another one had failed
        [[nodiscard]] bool has_failed() const { return !message.empty(); }
    };
    /// Called once by every rank, when it is done or has failed: then the others, if they still
    /// work, learn so by check() or in an exchange. Returns when all have called it, with the
    /// ending that counts: of the first rank that failed by itself, which `who` names.
    Ending agree(const Ending& own, int& who);

  private:
    struct Sending {
        std::vector<std::byte> bytes;
        MPI_Request request = MPI_REQUEST_NULL;
    };
    /// Whether a rank has failed; throws nothing.
    bool has_failed();
    void require_going_on();
    bool finish_sending();
    void drop_messages();
    Ending gather_endings(const Ending& own, int& who);

    const std::function<bool()> stop_;
    int rank_ = 0;
    int size_ = 1;
    std::string host_;
    std::mutex mutex_;  ///< of all calls of MPI
    std::deque<Sending> sending_;
    std::uint64_t exchanges_ = 0;
    std::atomic<bool> failed_ = false;
    bool is_stop_ignored_ = false;
    std::atomic<std::chrono::steady_clock::rep> next_look_ = 0;
};

}  // namespace isonest::detail
