// Meshes in text: Wavefront OBJ, and the XML inside of 3MF.
#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <istream>
#include <memory>
#include <streambuf>
#include <string>
#include <string_view>
#include <system_error>

#include <isonest/error.h>

#include "preprocess/sources/bytes/zip_directory.h"
#include "tools/drawing/input/mesh_input.h"

namespace isonest::detail::cli {
namespace {

constexpr std::size_t kLongestLine = std::size_t{1} << 20U;

bool to_number(std::string_view word, double& value) {
    return std::from_chars(word.data(), word.data() + word.size(), value).ec == std::errc{};
}

std::string_view next_word(std::string_view& line) {
    const std::size_t begin = std::min(line.find_first_not_of(" \t\r"), line.size());
    const std::size_t end = std::min(line.find_first_of(" \t\r", begin), line.size());
    const std::string_view word = line.substr(begin, end - begin);
    line.remove_prefix(end);
    return word;
}

void read_face(std::string_view line, PlyScratch& to) {
    std::array<std::uint64_t, 3> corners{};
    for (std::size_t count = 0;; ++count) {
        const std::string_view word = next_word(line);
        if (word.empty()) {
            if (count < 3) {
                to.fail("a face has fewer than three corners");
            }
            return;
        }
        std::int64_t number = 0;
        std::from_chars(word.data(), word.data() + word.size(), number);
        // Negative ones count from the last vertex.
        const std::int64_t corner =
            number < 0 ? static_cast<std::int64_t>(to.vertices()) + number : number - 1;
        if (corner < 0) {
            to.fail(fmt::format("'{}' is no corner of a face", word));
        }
        corners.at(std::min<std::size_t>(count, 2)) = static_cast<std::uint64_t>(corner);
        if (count >= 2) {
            to.triangle(corners);
            corners[1] = corners[2];
        }
    }
}

/// A file's member, unpacked piece by piece.
class Inflated {
  public:
    Inflated(const std::filesystem::path& path, const ZipMember& member)
        : name_(path.string()), file_(path, std::ios::binary), member_(member) {
        file_.seekg(static_cast<std::streamoff>(member.start));
        if (inflateInit2(&stream_, -MAX_WBITS) != Z_OK) {
            throw Error(ErrorKind::limit, {name_}, "zlib has no memory");
        }
    }
    Inflated(const Inflated&) = delete;
    Inflated& operator=(const Inflated&) = delete;
    ~Inflated() { inflateEnd(&stream_); }
    /// Adds to `text`; false at the end.
    bool more(std::string& text) {
        if (ended_) {
            return false;
        }
        std::array<char, 65536> out{};
        stream_.next_out = reinterpret_cast<Bytef*>(out.data());
        stream_.avail_out = out.size();
        if (stream_.avail_in == 0) {
            const auto count = std::min<std::uint64_t>(in_.size(), member_.packed - read_);
            file_.read(in_.data(), static_cast<std::streamsize>(count));
            read_ += count;
            stream_.next_in = reinterpret_cast<Bytef*>(in_.data());
            stream_.avail_in = static_cast<uInt>(file_.gcount());
        }
        if (!member_.deflated) {
            text.append(in_.data(), stream_.avail_in);
            ended_ = stream_.avail_in == 0;
            stream_.avail_in = 0;
            return !ended_;
        }
        const int result = inflate(&stream_, Z_NO_FLUSH);
        if (result != Z_OK && result != Z_STREAM_END) {
            throw Error(ErrorKind::corrupt, {name_, member_.name}, "cannot be unpacked",
                        {{RemedyKind::good_copy}});
        }
        text.append(out.data(), out.size() - stream_.avail_out);
        ended_ = result == Z_STREAM_END;
        return true;
    }

  private:
    std::string name_;
    std::ifstream file_;
    ZipMember member_;
    z_stream stream_{};
    std::array<char, 65536> in_{};
    std::uint64_t read_ = 0;
    bool ended_ = false;
};

/// The number of an attribute of a tag.
double attribute(std::string_view tag, std::string_view name, const PlyScratch& to) {
    for (std::size_t at = tag.find(name); at != std::string_view::npos;
         at = tag.find(name, at + 1)) {
        std::string_view rest = tag.substr(at + name.size());
        const bool begins = at > 0 && (tag[at - 1] == ' ' || tag[at - 1] == '\n');
        if (begins && rest.size() > 2 && rest[0] == '=' && (rest[1] == '"' || rest[1] == '\'')) {
            double value = 0;
            if (to_number(rest.substr(2), value)) {
                return value;
            }
        }
    }
    to.fail(fmt::format("<{}> has no number {}", tag.substr(0, 60), name));
}

/// Without its end; of a line that is too long the first kLongestLine + 1 characters. False at the
/// end of the file.
bool next_line(std::istream& file, std::string& line) {
    line.clear();
    std::streambuf& in = *file.rdbuf();
    for (int next = in.sbumpc(); next != std::char_traits<char>::eof(); next = in.sbumpc()) {
        if (next == '\n') {
            return true;
        }
        line += static_cast<char>(next);
        if (line.size() > kLongestLine) {
            return true;
        }
    }
    return !line.empty();
}

}  // namespace

void read_obj(const std::filesystem::path& path, PlyScratch& to, Progress& progress) {
    // A FIFO would be waited for.
    if (std::error_code ignored; std::filesystem::exists(path, ignored) &&
                                 !std::filesystem::is_regular_file(path, ignored)) {
        throw Error(ErrorKind::invalid_argument, {path.string()}, "not a regular file");
    }
    std::ifstream file(path);
    if (!file) {
        throw Error(ErrorKind::not_found, {path.string()}, "cannot open");
    }
    std::string line;
    for (std::uint64_t number = 1; next_line(file, line); ++number) {
        if (number % 65536 == 0) {
            progress.check();
        }
        if (line.size() > kLongestLine) {
            to.fail(fmt::format("line {} has more than {} characters", number, kLongestLine));
        }
        std::string_view rest = line;
        const std::string_view key = next_word(rest);
        if (key == "v") {
            std::array<double, 3> p{};
            for (double& c : p) {
                if (!to_number(next_word(rest), c)) {
                    to.fail(fmt::format("line {} is no vertex", number));
                }
            }
            to.vertex(p, NAN);
        } else if (key == "f") {
            read_face(rest, to);
        }
    }
}

/// Of the first object: its parts <vertex x y z/> and <triangle v1 v2 v3/>.
void read_3mf(const std::filesystem::path& path, PlyScratch& to, Progress& progress) {
    const std::vector<ZipMember> members = read_zip_directory(path);
    const auto model = std::find_if(members.begin(), members.end(), [](const ZipMember& m) {
        return m.name.ends_with(".model") && m.readable;
    });
    if (model == members.end()) {
        to.fail("the archive has no model");
    }
    Inflated stream(path, *model);
    std::string text;
    while (stream.more(text)) {
        progress.check();
        std::size_t done = 0;
        for (std::size_t begin = text.find('<'); begin != std::string::npos;
             begin = text.find('<', done)) {
            const std::size_t end = text.find('>', begin);
            if (end == std::string::npos) {
                break;
            }
            const std::string_view tag(text.data() + begin + 1, end - begin - 1);
            if (tag.starts_with("vertex ")) {
                to.vertex(
                    {attribute(tag, "x", to), attribute(tag, "y", to), attribute(tag, "z", to)},
                    NAN);
            } else if (tag.starts_with("triangle ")) {
                std::array<std::uint64_t, 3> corners{};
                constexpr std::array<std::string_view, 3> kNames{"v1", "v2", "v3"};
                for (std::size_t i = 0; i < 3; ++i) {
                    const double corner = attribute(tag, kNames.at(i), to);
                    if (!(corner >= 0 && corner < 4294967296.0)) {
                        to.fail(fmt::format("{} is no corner of a triangle", corner));
                    }
                    corners.at(i) = static_cast<std::uint64_t>(corner);
                }
                to.triangle(corners);
            } else if (tag == "/object") {
                return;
            }
            done = end + 1;
        }
        text.erase(0, done);
        if (text.size() > kLongestLine) {
            to.fail("a tag of more than a megabyte");
        }
    }
}

}  // namespace isonest::detail::cli
