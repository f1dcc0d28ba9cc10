#include "query/ranks/mesh_on_ranks.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "query/formats/mesh_files.h"
#include "query/mesh/weld.h"
#include "query/ranks/rank_apart.h"
#include "query/ranks/rank_mapping.h"
#include "query/ranks/rank_weld.h"

namespace isonest::detail {

// A rank's parts are a sequence of records, each followed by its part's bytes, divided into
// messages. A record is always within one message.

namespace {

/// Sent before the parts.
struct Announcement {
    std::uint64_t messages = 0;
    PartTotals totals;
};
static_assert(std::is_trivially_copyable_v<Announcement> &&
              std::is_trivially_copyable_v<PartRecord>);

/// Creates a rank's messages one after another.
class PartSender {
  public:
    explicit PartSender(PartStore& parts) : parts_(parts) {}

    /// Total number of messages.
    [[nodiscard]] std::uint64_t count() const {
        std::uint64_t messages = 0;
        std::size_t room = 0;
        for (const PartRecord& r : parts_.records()) {
            if (room < sizeof(PartRecord)) {
                ++messages;
                room = Communicator::kMaxBytes;
            }
            room -= sizeof(PartRecord);
            std::uint64_t left = parts_.count_bytes(r);
            while (left > 0) {
                if (room == 0) {
                    ++messages;
                    room = Communicator::kMaxBytes;
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
        return Communicator::kMaxBytes - message.bytes.size();
    }
    static void put(Communicator::Message& message, std::span<const std::byte> bytes) {
        message.bytes.insert(message.bytes.end(), bytes.begin(), bytes.end());
    }

    PartStore& parts_;
    std::size_t record_ = 0;
    std::size_t at_ = 0;  ///< in the bytes of the part whose record was already put into a message
    bool is_begun_ = false;
};

/// Stores the messages of one rank.
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

/// On rank 0: includes the announcements of the others. Returns the number of messages with their
/// parts.
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

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}

/// Null if the file cannot be written by all ranks.
SectionedFile* file_behind(MeshSink& sink) {
    auto* const measuring = dynamic_cast<MeasuringSink*>(&sink);
    return measuring == nullptr ? nullptr : dynamic_cast<SectionedFile*>(&measuring->inner());
}

/// The layout for the other ranks, followed by the result of SectionedFile::share().
struct SharedLayout {
    std::uint64_t vertices = 0;
    std::uint64_t elements = 0;
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    bool measures_angles = false;
};

/// Adds the measurements of all ranks to those of rank 0, once their rows are on disk, and
/// completes data shared by several ranks. `loose_ends`: of another rank's rows. `file`: on rank 0,
/// otherwise null.
void gather_sums(Communicator& ranks, MeasuringSink& measuring, const std::string& loose_ends,
                 SectionedFile* file) {
    bool is_sent = ranks.rank() == 0;
    ranks.exchange(
        [&](Communicator::Message& message) {
            if (is_sent) {
                return false;
            }
            is_sent = true;
            const std::string own = measuring.sums();
            const std::string sums = text_of_value(own.size()) + own + loose_ends;
            const auto bytes = std::as_bytes(std::span(sums));
            message = {0, {bytes.begin(), bytes.end()}};
            return true;
        },
        ranks.rank() == 0 ? static_cast<std::uint64_t>(ranks.size()) - 1 : 0,
        [&](int /*from*/, std::span<const std::byte> bytes) {
            const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
            const auto size = value_of_text<std::size_t>(text);
            measuring.include(text.substr(sizeof(size), size));
            file->include(text.substr(sizeof(size) + size));
        });
}

/// The work of all ranks before the file is written.
class WeldedOnRanks {
  public:
    WeldedOnRanks(RankTeam& team, PartStore& parts, const std::optional<ApartRange>& range,
                  const ScratchFolder& folder, Progress& progress)
        : start_(Clock::now()), weld_(team.ranks, parts, folder) {
        if (range) {
            apart_ = keep_apart_on_ranks(team.ranks, parts, weld_, *range, folder, progress);
        }
        ++team.work.meshes;
        team.work.welding_seconds += seconds_since(start_);
    }
    [[nodiscard]] const RankWeld& weld() const { return weld_; }
    [[nodiscard]] const ApartVertices& apart() const { return apart_; }

  private:
    Clock::time_point start_;
    RankWeld weld_;
    ApartVertices apart_;
};

void emit_own(RankTeam& team, const PartStore& parts, const RankWeld& weld, MeshSink& sink,
              Progress& progress) {
    emit_parts(parts, weld, sink, progress);
    for (const PartRecord& r : parts.records()) {
        team.work.written_triangles += r.triangles;
    }
}

}  // namespace

bool is_written_by_all(MeshSink& sink) {
    return file_behind(sink) != nullptr;
}

MeshOnRanks mesh_on_ranks(RankTeam& team, PartStore& parts, std::optional<ApartRange> apart,
                          MeshLayout layout, MeshSink& sink, const ScratchFolder& folder,
                          Progress& progress) {
    if (apart) {
        apart->lo = parts.lo();
        apart->hi = parts.hi();
    }
    team.ranks.broadcast(text_of_value(apart.has_value()));
    const WeldedOnRanks welded(team, parts, apart, folder, progress);
    const auto start = Clock::now();
    auto& measuring = dynamic_cast<MeasuringSink&>(sink);
    layout.vertices = welded.weld().vertices();
    layout.elements = welded.weld().triangles();
    layout.lo = parts.lo();
    layout.hi = parts.hi();
    sink.begin(layout);
    const SharedLayout shared{layout.vertices, layout.elements, layout.lo, layout.hi,
                              measuring.measures_angles()};
    team.ranks.broadcast(text_of_value(shared) + file_behind(sink)->share());
    emit_own(team, parts, welded.weld(), sink, progress);
    gather_sums(team.ranks, measuring, {}, file_behind(sink));
    sink.end();
    team.work.writing_seconds += seconds_since(start);
    return {layout.vertices, layout.elements, welded.apart()};
}

void help_with_mesh(RankTeam& team, PartStore& parts, const ScratchFolder& folder,
                    Progress& progress) {
    std::optional<ApartRange> apart;
    if (value_of_text<bool>(team.ranks.broadcast({}))) {
        apart.emplace();
    }
    const WeldedOnRanks welded(team, parts, apart, folder, progress);
    const std::string text = team.ranks.broadcast({});
    const auto start = Clock::now();
    const auto shared = value_of_text<SharedLayout>(text);
    MeshLayout layout;
    layout.vertices = shared.vertices;
    layout.elements = shared.elements;
    layout.lo = shared.lo;
    layout.hi = shared.hi;
    RowWriter rows(std::string_view(text).substr(sizeof(shared)));
    MeasuringSink measuring(rows, shared.measures_angles);
    measuring.begin(layout);
    emit_own(team, parts, welded.weld(), measuring, progress);
    measuring.end();
    // The rest is done by rank 0; once it has this rank's sums, it publishes the mesh.
    team.ranks.ignore_stop(true);
    gather_sums(team.ranks, measuring, rows.loose_ends(), nullptr);
    team.work.writing_seconds += seconds_since(start);
}

}  // namespace isonest::detail
