#include "store/ranks/same_folder.h"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <iterator>
#include <optional>
#include <random>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include <isonest/error.h>

#include "store/files/output_file.h"
#include "store/files/scratch_file.h"
#include "store/ranks/who_differs.h"

namespace isonest::detail {
namespace {

constexpr char kInside = 'i';
constexpr char kBeside = 'b';

/// A name that nobody else has. It begins as those of temporary files do, so that the next run
/// names what was left by one that was killed.
std::string random_name() {
    std::random_device device;
    return fmt::format("{}{}-{:08x}{:08x}", ScratchFile::kPrefix, ::getpid(), device(), device());
}

/// A file that is there as long as the object.
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
    // Rank 0 tells where to look: in the output or beside it, nowhere where it has no folder.
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
        throw Error(ErrorKind::invalid_argument, {output.string()},
                    "its folder is not the same for all ranks: what rank 0 writes there, do not "
                    "see ranks " +
                        others,
                    {{RemedyKind::other_name}});
    }
    ranks.meet();
}

}  // namespace isonest::detail
