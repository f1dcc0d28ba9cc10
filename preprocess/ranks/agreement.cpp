#include "preprocess/ranks/agreement.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <optional>
#include <random>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/field.h>

#include "store/base/label_text.h"
#include "store/container/codec.h"
#include "store/container/format.h"
#include "store/files/output_file.h"
#include "store/ranks/who_differs.h"

namespace isonest::detail {
namespace {

std::string digest_of(const std::string& text) {
    return fmt::format("{:016x}", checksum_of(std::as_bytes(std::span(text))));
}

/// All that decides which values lie where; not what the input is called.
std::string input_text(const VolumeSource& source) {
    const VolumeDescription v = source.describe();
    std::string text =
        fmt::format("{}\n{} {} {} {} {} {} {}\n", source.identity(), v.nodes.x, v.nodes.y,
                    v.nodes.z, name_of(v.type), v.labels, v.unit ? static_cast<int>(*v.unit) : -1,
                    fmt::format("{} {}", fmt::join(v.spacing, " "), fmt::join(v.origin, " ")));
    for (const Double3& axis : v.direction) {
        text += fmt::format("{}\n", fmt::join(axis, " "));
    }
    for (const LabelName& name : source.label_names()) {
        text += fmt::format("{} {}\n", name.id, name.name);
    }
    return text;
}

std::string options_text(const PreprocessOptions& options) {
    return fmt::format("{} {} {} {} {} {}", options.chunk, options.compression, options.exact,
                       options.force, options.resume, list_names(options.fields));
}

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

void require_same_work(Communicator& ranks, const VolumeSource& source,
                       const PreprocessOptions& options) {
    const std::string input = digest_of(input_text(source));
    const std::string chosen = digest_of(options_text(options));
    const std::string other_inputs = who_differs(ranks, input, input);
    const std::string other_choices = who_differs(ranks, chosen, chosen);
    if (!other_inputs.empty()) {
        throw Error(ErrorKind::invalid_argument, {source.describe().name},
                    "ranks see different inputs: not what rank 0 sees, see ranks " + other_inputs);
    }
    if (!other_choices.empty()) {
        throw Error(
            ErrorKind::invalid_argument, {source.describe().name},
            "ranks have different options: not those of rank 0, have ranks " + other_choices);
    }
    ranks.meet();
}

void require_same_folder(Communicator& ranks, const std::filesystem::path& store) {
    const std::string text = ranks.broadcast(ranks.rank() == 0 ? random_text() : "");
    const std::filesystem::path path = (temporary_prefix(store) += "seen-" + text);
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
        throw Error(ErrorKind::invalid_argument, {store.string()},
                    "its folder is not the same for all ranks: what rank 0 writes there, do not "
                    "see ranks " +
                        others,
                    {{RemedyKind::other_name}});
    }
    ranks.meet();
}

}  // namespace isonest::detail
