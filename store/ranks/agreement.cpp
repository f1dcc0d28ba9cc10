#include "store/ranks/agreement.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <fstream>
#include <iterator>
#include <optional>
#include <random>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/files/output_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {
namespace {

constexpr char kInside = 'i';
constexpr char kBeside = 'b';

/// A unique name. It starts like those of temporary files, so that the next run reports files left
/// behind by a killed one.
std::string random_name() {
    std::random_device device;
    return fmt::format("{}{}-{:08x}{:08x}", ScratchFile::kPrefix, ::getpid(), device(), device());
}

/// A file that exists as long as this object.
class Token {
  public:
    Token(std::filesystem::path path, const std::string& text) : path_(std::move(path)) {
        std::ofstream file(path_, std::ios::binary);
        file << text << std::flush;
        if (!file) {
            remove();
            throw Error(ErrorKind::io, {path_.string()}, "cannot write into the output's folder");
        }
    }
    Token(const Token&) = delete;
    Token& operator=(const Token&) = delete;
    ~Token() { remove(); }

  private:
    void remove() const {
        std::error_code ignored;
        std::filesystem::remove(path_, ignored);
    }

    std::filesystem::path path_;
};

std::string text_in(const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

}  // namespace

void require_same_folder(Communicator& ranks, const std::filesystem::path& output) {
    if (ranks.size() == 1) {
        return;
    }
    std::error_code ignored;
    const std::filesystem::path beside = temporary_prefix(output).parent_path();
    // Rank 0 announces where to look: in the output or beside it, or nowhere if it has no folder.
    std::string where;
    if (ranks.rank() == 0 && std::filesystem::is_directory(output, ignored)) {
        where = kInside + random_name();
    } else if (ranks.rank() == 0 && std::filesystem::is_directory(beside, ignored)) {
        where = kBeside + random_name();
    }
    where = ranks.broadcast(where);
    if (where.empty()) {
        return;
    }
    const std::string text = where.substr(1);
    const std::filesystem::path path = (where.front() == kInside ? output : beside) / text;
    std::optional<Token> token;
    if (ranks.rank() == 0) {
        token.emplace(path, text);
    }
    ranks.meet();
    constexpr int kTries = 50;
    constexpr auto kPause = std::chrono::milliseconds(100);
    bool seen = text_in(path) == text;
    for (int i = 0; i < kTries && !seen; ++i) {
        std::this_thread::sleep_for(kPause);
        seen = text_in(path) == text;
    }
    const std::string others = who_differs(ranks, seen ? "seen" : "not seen", "seen");
    if (!others.empty()) {
        throw Error(
            ErrorKind::invalid_argument, {output.string()},
            "its folder is not shared: files that rank 0 writes there are not visible to ranks " +
                others,
            {{RemedyKind::other_name}});
    }
    ranks.meet();
}

std::string who_differs(Communicator& ranks, std::string_view own, std::string_view expected) {
    const std::vector<std::string> all = ranks.gather(fmt::format("{}\n{}", own, ranks.host()));
    std::vector<std::string> names;
    constexpr std::size_t kMax = 8;
    for (std::size_t r = 0; r < all.size(); ++r) {
        const std::size_t end = all[r].find('\n');
        if (all[r].substr(0, end) != expected) {
            names.push_back(fmt::format("{} ({})", r, all[r].substr(end + 1)));
        }
    }
    const std::size_t more = names.size() > kMax ? names.size() - kMax : 0;
    names.resize(names.size() - more);
    return fmt::format("{}{}", fmt::join(names, ", "),
                       more > 0 ? fmt::format(" and {} more", more) : "");
}

}  // namespace isonest::detail
