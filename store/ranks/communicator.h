// Ranks: processes on one or several machines that do one piece of work together and exchange
// messages. Communicator hides how the messages are transported.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace isonest::detail {

/// What a rank has sent and received so far, and the time it has waited in exchanges.
struct RankTraffic {
    std::uint64_t messages_sent = 0;
    std::uint64_t bytes_sent = 0;
    std::uint64_t messages_received = 0;
    std::uint64_t bytes_received = 0;
    double seconds = 0;
};

/// One rank's view of all ranks. Ranks are numbered from 0. All methods except const ones, check()
/// and ignore_stop() are *collective*: all ranks call the same ones in the same order. They throw
/// Error{cancelled} as soon as another rank has failed, and what the given functions throw.
/// Thread-safety: check() and const methods from any thread; the others from one thread at a time.
class Communicator {
  public:
    /// Maximum size of a message in bytes.
    static constexpr std::size_t kMaxBytes = std::size_t{1} << 20U;
    struct Message {
        int to = 0;
        std::vector<std::byte> bytes;
    };
    /// Stores the next message in its argument; false if there are no more.
    using Next = std::function<bool(Message&)>;
    using Take = std::function<void(int from, std::span<const std::byte> bytes)>;

    Communicator() = default;
    Communicator(const Communicator&) = delete;
    Communicator& operator=(const Communicator&) = delete;
    virtual ~Communicator() = default;

    [[nodiscard]] virtual int rank() const = 0;
    [[nodiscard]] virtual int size() const = 0;
    /// Name of the machine.
    [[nodiscard]] virtual std::string host() const = 0;

    /// Sends all messages that `next` provides, and passes the `expected` messages that others send
    /// to this rank in the same exchange to `take`. Messages from one rank arrive in the order
    /// sent. Only a few messages are in memory at a time. REQUIRES: messages of at most kMaxBytes,
    /// none to this rank itself, and consistent numbers of messages.
    virtual void exchange(const Next& next, std::uint64_t expected, const Take& take) = 0;
    /// Throws Error{cancelled} if another rank has failed.
    virtual void check() = 0;
    /// Until it is called with false, this rank waits for others even if it was asked to stop,
    /// because its part of the work is done; only the failure of another rank ends its exchanges.
    /// Affects this rank only.
    virtual void ignore_stop(bool /*is_ignored*/) {}
    [[nodiscard]] const RankTraffic& traffic() const { return traffic_; }

    /// Rank 0 gets the texts of all ranks, in the order of the ranks; the others get none.
    /// REQUIRES: texts of at most kMaxBytes.
    std::vector<std::string> gather(std::string_view text);
    /// All ranks get rank 0's text, of at most kMaxBytes.
    std::string broadcast(std::string text);
    /// All ranks get, for each number, the sum or the maximum over all ranks.
    void sum(std::span<std::uint64_t> numbers);
    void largest(std::span<double> numbers);
    /// Returns when all ranks have called it.
    void meet();

  protected:
    RankTraffic traffic_;
};

/// The communicator of a process that works alone. Thread-safe.
class OneRank : public Communicator {
  public:
    [[nodiscard]] int rank() const override { return 0; }
    [[nodiscard]] int size() const override { return 1; }
    [[nodiscard]] std::string host() const override;
    void exchange(const Next& next, std::uint64_t expected, const Take& take) override;
    void check() override {}
};

}  // namespace isonest::detail
