#include "store/ranks/same_folder.h"

#include <fmt/format.h>

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
#include "store/ranks/who_differs.h"

namespace isonest::detail {
namespace {

/// A text that nobody else has.
std::string random_text() {
    std::random_device device;
    return fmt::format("{:08x}{:08x}{:08x}{:08x}", device(), device(), device(), device());
}

/// A file that is there as long as the object.
class Token {
  public:
    Token(std::filesystem::path path, const std::string& text) : path_(std::move(path)) {
        std::ofstream file(path_, std::ios::binary);
        file << text << std::flush;
        if (!file) {
            throw Error(ErrorKind::io, {path_.string()}, "cannot write into the output's folder");
        }
    }
    Token(const Token&) = delete;
    Token& operator=(const Token&) = delete;
    ~Token() {
        std::error_code ignored;
        std::filesystem::remove(path_, ignored);
    }

  private:
    std::filesystem::path path_;
};

std::string text_in(const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

}  // namespace

void require_same_folder(Communicator& ranks, const std::filesystem::path& output) {
    const std::filesystem::path prefix = temporary_prefix(output);
    const bool is_there = ranks.rank() == 0 && std::filesystem::is_directory(prefix.parent_path());
    const std::string text = ranks.broadcast(is_there ? random_text() : "");
    if (text.empty()) {
        return;
    }
    const std::filesystem::path path = std::filesystem::path(prefix) += "seen-" + text;
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
