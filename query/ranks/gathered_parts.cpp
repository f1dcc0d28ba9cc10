// A rank's parts are a row of records, each with its part's bytes behind it, cut into messages.
// A record lies in one message.
#include "query/ranks/gathered_parts.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace isonest::detail {
namespace {

/// Ahead of the parts.
struct Announcement {
    std::uint64_t messages = 0;
    PartTotals totals;
};
static_assert(std::is_trivially_copyable_v<Announcement> &&
              std::is_trivially_copyable_v<PartRecord>);

/// Makes a rank's messages one after the other.
class PartSender {
  public:
    explicit PartSender(PartStore& parts) : parts_(parts) {}

    /// How many there will be.
    [[nodiscard]] std::uint64_t count() const {
        std::uint64_t messages = 0;
        std::size_t room = 0;
        for (const PartRecord& r : parts_.records()) {
            if (room < sizeof(PartRecord)) {
                ++messages;
                room = Communicator::kMostBytes;
            }
            room -= sizeof(PartRecord);
            std::uint64_t left = parts_.count_bytes(r);
            while (left > 0) {
                if (room == 0) {
                    ++messages;
                    room = Communicator::kMostBytes;
                }
                const auto here = std::min<std::uint64_t>(left, room);
                room -= here;
                left -= here;
            }
        }
        return messages;
    }

    bool next(Communicator::Message& message) {
        message.to = 0;
        message.bytes.clear();
        const auto records = parts_.records();
        while (record_ < records.size()) {
            const PartRecord& r = records[record_];
            if (!is_begun_) {
                if (room(message) < sizeof(PartRecord)) {
                    return true;
                }
                put(message, std::as_bytes(std::span(&r, 1)));
                is_begun_ = true;
                at_ = 0;
            }
            const auto bytes = parts_.all_bytes(r);
            const std::size_t here = std::min(bytes.size() - at_, room(message));
            put(message, bytes.subspan(at_, here));
            at_ += here;
            if (at_ < bytes.size()) {
                return true;
            }
            parts_.release(r);
            is_begun_ = false;
            ++record_;
        }
        return !message.bytes.empty();
    }

  private:
    static std::size_t room(const Communicator::Message& message) {
        return Communicator::kMostBytes - message.bytes.size();
    }
    static void put(Communicator::Message& message, std::span<const std::byte> bytes) {
        message.bytes.insert(message.bytes.end(), bytes.begin(), bytes.end());
    }

    PartStore& parts_;
    std::size_t record_ = 0;
    std::size_t at_ = 0;  ///< in the bytes of the part whose record was put into a message
    bool is_begun_ = false;
};

/// Puts the messages of one rank into a store.
class PartReceiver {
  public:
    void take(PartStore& parts, std::span<const std::byte> bytes) {
        while (!bytes.empty()) {
            if (at_ == end_) {
                PartRecord record;
                std::memcpy(&record, bytes.data(), sizeof(record));
                bytes = bytes.subspan(sizeof(record));
                at_ = 0;
                end_ = parts.count_bytes(record);
                record_ = parts.add(record);
            }
            const auto here = std::min<std::uint64_t>(end_ - at_, bytes.size());
            parts.put(record_, at_, bytes.first(here));
            bytes = bytes.subspan(here);
            at_ += here;
        }
    }

  private:
    PartRecord record_;
    std::uint64_t at_ = 0;
    std::uint64_t end_ = 0;
};

void send(Communicator& ranks, PartSender& sender) {
    ranks.exchange([&](Communicator::Message& message) { return sender.next(message); }, 0,
                   [](int, std::span<const std::byte>) {});
}

void receive(Communicator& ranks, std::uint64_t messages, PartStore& parts) {
    std::vector<PartReceiver> receivers(static_cast<std::size_t>(ranks.size()));
    ranks.exchange([](Communicator::Message&) { return false; }, messages,
                   [&](int from, std::span<const std::byte> bytes) {
                       receivers[static_cast<std::size_t>(from)].take(parts, bytes);
                   });
}

/// Of rank 0: includes what the others announce. Returns how many messages their parts are.
std::uint64_t hear_announcements(Communicator& ranks, PartStore& parts) {
    std::uint64_t messages = 0;
    const std::vector<std::string> all = ranks.gather({});
    for (std::size_t rank = 1; rank < all.size(); ++rank) {
        Announcement other;
        std::memcpy(&other, all[rank].data(), sizeof(other));
        parts.include(other.totals);
        messages += other.messages;
    }
    return messages;
}

}  // namespace

SettledParts settle_parts(Communicator& ranks, PartStore& parts,
                          const std::function<bool()>& may_stay) {
    const std::uint64_t own = parts.bytes();
    constexpr std::string_view kStay = "stay";
    if (ranks.rank() == 0) {
        const std::uint64_t messages = hear_announcements(ranks, parts);
        const bool stay = may_stay && may_stay();
        ranks.broadcast(std::string(stay ? kStay : ""));
        if (!stay) {
            receive(ranks, messages, parts);
        }
        parts.seal();
        return {own, stay};
    }
    parts.seal();
    PartSender sender(parts);
    const Announcement announcement{sender.count(), parts.totals()};
    ranks.gather({reinterpret_cast<const char*>(&announcement), sizeof(announcement)});
    const bool stay = ranks.broadcast({}) == kStay;
    if (!stay) {
        send(ranks, sender);
    }
    return {own, stay};
}

}  // namespace isonest::detail
