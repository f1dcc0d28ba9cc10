// Ranks: processes, on one machine or on several, that do one piece of work together and tell each
// other what they need by messages. What carries the messages is behind Communicator.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace isonest::detail {

/// What a rank has sent and received so far, and how long it has waited in exchanges.
struct RankTraffic {
    std::uint64_t messages_sent = 0;
    std::uint64_t bytes_sent = 0;
    std::uint64_t messages_received = 0;
    std::uint64_t bytes_received = 0;
    double seconds = 0;
};

/// One rank's view of all of them. Ranks are numbered from 0.
/// Every method but those that are const, check() and ignore_stop() is *collective*: all ranks call
/// the same ones in the same order. They throw Error{cancelled} as soon as another rank has failed,
/// and what the functions that they are given throw. Thread-safety: check() and const methods from
/// any thread; the others from one thread at a time.
class Communicator {
  public:
    /// Of a message, in bytes.
    static constexpr std::size_t kMostBytes = std::size_t{1} << 20U;
    struct Message {
        int to = 0;
        std::vector<std::byte> bytes;
    };
    /// Puts the next message into its argument; false if there is none any more.
    using Next = std::function<bool(Message&)>;
    using Take = std::function<void(int from, std::span<const std::byte> bytes)>;

    Communicator() = default;
    Communicator(const Communicator&) = delete;
    Communicator& operator=(const Communicator&) = delete;
    virtual ~Communicator() = default;

    [[nodiscard]] virtual int rank() const = 0;
    [[nodiscard]] virtual int size() const = 0;
    /// The machine's name.
    [[nodiscard]] virtual std::string host() const = 0;

    /// Sends all messages that `next` gives, and hands the `expected` ones that others send to this
    /// rank in the same exchange to `take`. Those of one rank come in its order. A few messages are
    /// in memory at a time. REQUIRES: messages of at most kMostBytes, none to this rank itself, and
    /// numbers that agree.
    virtual void exchange(const Next& next, std::uint64_t expected, const Take& take) = 0;
    /// Throws Error{cancelled} if another rank has failed.
    virtual void check() = 0;
    /// From here on, until it is called with false, this rank waits for others even when it was
    /// asked to stop, for its part of the work is done; only that another one fails ends its
    /// exchanges. For itself alone.
    virtual void ignore_stop(bool /*is_ignored*/) {}
    [[nodiscard]] const RankTraffic& traffic() const { return traffic_; }

    /// Rank 0 gets the texts of all, in the order of the ranks; the others get none. REQUIRES:
    /// texts of at most kMostBytes.
    std::vector<std::string> gather(std::string_view text);
    /// All get rank 0's text, of at most kMostBytes.
    std::string broadcast(std::string text);
    /// All get the sums over all ranks, number by number, or the largest.
    void sum(std::span<std::uint64_t> numbers);
    void largest(std::span<double> numbers);
    /// Returns when all have come here.
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
