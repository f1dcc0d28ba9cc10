#include "tools/mpi/mpi_communicator.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <stdexcept>
#include <thread>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

using Clock = std::chrono::steady_clock;

/// Message tags. Each exchange has its own tag, so that a rank that is ahead does not disturb
/// others.
constexpr int kFailed = 1;   ///< to rank 0: this rank has failed, and how it ended
constexpr int kDone = 2;     ///< to rank 0: this rank is done
constexpr int kVerdict = 3;  ///< from rank 0: empty: a rank has failed; else how the run ended
constexpr int kFirst = 16;
constexpr int kExchanges = 16384;  ///< the standard guarantees tags up to 32767

constexpr std::size_t kMaxSending = 2;

/// The wait between two polls: first none, then up to a millisecond.
class Patience {
  public:
    void reset() { looks_ = 0; }
    void wait() {
        constexpr int kEager = 200;
        constexpr int kMax = 1000;  // microseconds
        if (++looks_ < kEager) {
            std::this_thread::yield();
        } else {
            std::this_thread::sleep_for(
                std::chrono::microseconds(std::min(kMax, 10 * (looks_ - kEager + 1))));
        }
    }

  private:
    int looks_ = 0;
};

bool is_there(int from, int tag, MPI_Message& message, MPI_Status& status) {
    int found = 0;
    MPI_Improbe(from, tag, MPI_COMM_WORLD, &found, &message, &status);
    return found != 0;
}

bool is_waiting(int from, int tag) {
    int found = 0;
    MPI_Iprobe(from, tag, MPI_COMM_WORLD, &found, MPI_STATUS_IGNORE);
    return found != 0;
}

std::vector<std::byte> received(MPI_Message& message, const MPI_Status& status) {
    int count = 0;
    MPI_Get_count(&status, MPI_BYTE, &count);
    std::vector<std::byte> bytes(static_cast<std::size_t>(count));
    MPI_Mrecv(bytes.data(), count, MPI_BYTE, &message, MPI_STATUS_IGNORE);
    return bytes;
}

/// Texts are short here; they are truncated at the maximum size of a message.
std::vector<std::byte> packed(const MpiCommunicator::Ending& ending) {
    std::string text = std::to_string(ending.exit_code) + '\n' +
                       (ending.is_consequence ? '1' : '0') + '\n' + ending.message + '\0' +
                       ending.details;
    text.resize(std::min(text.size(), Communicator::kMaxBytes));
    const auto bytes = std::as_bytes(std::span(text));
    return {bytes.begin(), bytes.end()};
}

MpiCommunicator::Ending unpacked(std::span<const std::byte> bytes) {
    const std::string text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    const std::size_t first = text.find('\n');
    const std::size_t end = text.find('\0');
    MpiCommunicator::Ending ending;
    ending.exit_code = std::stoi(text.substr(0, first));
    ending.is_consequence = text[first + 1] == '1';
    ending.message = text.substr(first + 3, end - first - 3);
    ending.details = end == std::string::npos ? "" : text.substr(end + 1);
    return ending;
}

void send(int to, int tag, const std::vector<std::byte>& bytes, MPI_Request& request) {
    MPI_Isend(bytes.data(), static_cast<int>(bytes.size()), MPI_BYTE, to, tag, MPI_COMM_WORLD,
              &request);
}

}  // namespace

MpiCommunicator::MpiCommunicator(int& argc, char**& argv, std::function<bool()> stop)
    : stop_(std::move(stop)) {
    int provided = 0;
    MPI_Init_thread(&argc, &argv, MPI_THREAD_SERIALIZED, &provided);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
    MPI_Comm_size(MPI_COMM_WORLD, &size_);
    std::array<char, MPI_MAX_PROCESSOR_NAME> name{};
    int length = 0;
    MPI_Get_processor_name(name.data(), &length);
    host_.assign(name.data(), static_cast<std::size_t>(length));
    if (provided < MPI_THREAD_SERIALIZED && size_ > 1) {
        std::fputs("isonest-mpi: error: this MPI does not support threads\n", stderr);
        MPI_Abort(MPI_COMM_WORLD, static_cast<int>(ErrorKind::unsupported));
    }
}

MpiCommunicator::~MpiCommunicator() {
    MPI_Finalize();
}

bool MpiCommunicator::finish_sending() {
    while (!sending_.empty()) {
        int done = 0;
        MPI_Test(&sending_.front().request, &done, MPI_STATUS_IGNORE);
        if (done == 0) {
            return false;
        }
        sending_.pop_front();
    }
    return true;
}

bool MpiCommunicator::has_failed() {
    failed_ =
        failed_ || (rank_ == 0 ? is_waiting(MPI_ANY_SOURCE, kFailed) : is_waiting(0, kVerdict));
    return failed_;
}

void MpiCommunicator::require_going_on() {
    if (has_failed()) {
        throw Error(ErrorKind::cancelled, "another rank has failed");
    }
    if (!is_stop_ignored_ && stop_()) {
        throw Error(ErrorKind::cancelled, "interrupted; nothing was left behind");
    }
}

void MpiCommunicator::check() {
    constexpr auto kEvery = std::chrono::milliseconds(50);
    if (size_ == 1) {
        return;
    }
    const Clock::rep now = Clock::now().time_since_epoch().count();
    if (!failed_ && now >= next_look_) {
        const std::unique_lock lock(mutex_, std::try_to_lock);
        if (lock) {
            next_look_ = now + std::chrono::duration_cast<Clock::duration>(kEvery).count();
            has_failed();
        }
    }
    if (failed_) {
        throw Error(ErrorKind::cancelled, "another rank has failed");
    }
}

void MpiCommunicator::exchange(const Next& next, std::uint64_t expected, const Take& take) {
    const std::lock_guard lock(mutex_);
    const auto start = Clock::now();
    const int tag = kFirst + static_cast<int>(exchanges_++ % kExchanges);
    bool more = true;
    Patience patience;
    while (more || expected > 0 || !sending_.empty()) {
        bool moved = false;
        while (more && sending_.size() < kMaxSending) {
            Message message;
            more = next(message);
            if (!more) {
                break;
            }
            if (message.to < 0 || message.to >= size_ || message.to == rank_ ||
                message.bytes.size() > kMaxBytes) {
                throw std::logic_error("a message that no rank may send");
            }
            ++traffic_.messages_sent;
            traffic_.bytes_sent += message.bytes.size();
            Sending& sending = sending_.emplace_back();
            sending.bytes = std::move(message.bytes);
            send(message.to, tag, sending.bytes, sending.request);
            moved = true;
        }
        MPI_Message message = MPI_MESSAGE_NULL;
        MPI_Status status;
        if (is_there(MPI_ANY_SOURCE, tag, message, status)) {
            const std::vector<std::byte> bytes = received(message, status);
            if (expected == 0) {
                throw std::logic_error("a message that nobody expects");
            }
            --expected;
            ++traffic_.messages_received;
            traffic_.bytes_received += bytes.size();
            take(status.MPI_SOURCE, bytes);
            moved = true;
        }
        const std::size_t before = sending_.size();
        finish_sending();
        if (moved || sending_.size() != before) {
            patience.reset();
        } else {
            require_going_on();
            patience.wait();
        }
    }
    traffic_.seconds += std::chrono::duration<double>(Clock::now() - start).count();
}

/// Receives and discards messages that nobody needs any more.
void MpiCommunicator::drop_messages() {
    MPI_Message message = MPI_MESSAGE_NULL;
    MPI_Status status;
    while (is_there(MPI_ANY_SOURCE, MPI_ANY_TAG, message, status)) {
        received(message, status);
    }
}

MpiCommunicator::Ending MpiCommunicator::gather_endings(const Ending& own, int& who) {
    who = 0;
    Ending verdict = own;
    int open = size_ - 1;
    bool told = false;
    Patience patience;
    const std::vector<std::byte> nothing;
    for (;;) {
        if (verdict.has_failed() && !told) {
            told = true;
            for (int r = 1; r < size_; ++r) {
                sending_.emplace_back();
                send(r, kVerdict, nothing, sending_.back().request);
            }
        }
        if (open == 0) {
            break;
        }
        MPI_Message message = MPI_MESSAGE_NULL;
        MPI_Status status;
        if (!is_there(MPI_ANY_SOURCE, MPI_ANY_TAG, message, status)) {
            finish_sending();
            patience.wait();
            continue;
        }
        patience.reset();
        const std::vector<std::byte> bytes = received(message, status);
        if (status.MPI_TAG != kFailed && status.MPI_TAG != kDone) {
            continue;  // from an exchange that no longer takes place
        }
        --open;
        const Ending ending = unpacked(bytes);
        if (ending.has_failed() &&
            (!verdict.has_failed() || (verdict.is_consequence && !ending.is_consequence))) {
            verdict = ending;
            who = status.MPI_SOURCE;
        }
    }
    const std::vector<std::byte> bytes = packed(verdict);
    for (int r = 1; r < size_; ++r) {
        sending_.emplace_back().bytes = bytes;
        send(r, kVerdict, sending_.back().bytes, sending_.back().request);
    }
    return verdict;
}

MpiCommunicator::Ending MpiCommunicator::agree(const Ending& own, int& who) {
    const std::lock_guard lock(mutex_);
    Ending verdict = own;
    who = rank_;
    if (rank_ == 0) {
        verdict = gather_endings(own, who);
    } else {
        sending_.emplace_back().bytes = packed(own);
        send(0, own.has_failed() ? kFailed : kDone, sending_.back().bytes, sending_.back().request);
        Patience patience;
        for (bool is_known = false; !is_known;) {
            MPI_Message message = MPI_MESSAGE_NULL;
            MPI_Status status;
            if (!is_there(MPI_ANY_SOURCE, MPI_ANY_TAG, message, status)) {
                finish_sending();
                patience.wait();
                continue;
            }
            const std::vector<std::byte> bytes = received(message, status);
            if (status.MPI_TAG == kVerdict && !bytes.empty()) {
                verdict = unpacked(bytes);
                is_known = true;
            }
        }
    }
    // No rank leaves while another still sends.
    MPI_Request barrier = MPI_REQUEST_NULL;
    bool has_come = false;
    Patience patience;
    for (int all = 0; all == 0;) {
        drop_messages();
        if (!has_come && finish_sending()) {
            has_come = true;
            MPI_Ibarrier(MPI_COMM_WORLD, &barrier);
        }
        if (has_come) {
            MPI_Test(&barrier, &all, MPI_STATUS_IGNORE);
        }
        patience.wait();
    }
    return verdict;
}

}  // namespace isonest::detail
