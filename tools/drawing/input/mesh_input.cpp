#include "tools/drawing/input/mesh_input.h"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <istream>
#include <limits>
#include <memory>
#include <streambuf>
#include <string>
#include <string_view>
#include <system_error>

#include <isonest/error.h>

#include "preprocess/sources/bytes/packed_block.h"
#include "store/files/output_file.h"

namespace isonest::detail::cli {
namespace {

constexpr std::size_t kBuffer = std::size_t{1} << 20U;

struct Format {
    const char* extension;
    MeshInput read;
};
constexpr std::array<Format, 7> kFormats{{{".stl", read_stl},
                                          {".obj", read_obj},
                                          {".glb", read_glb},
                                          {".3mf", read_3mf},
                                          {".vtp", read_vtp},
                                          {".vtkhdf", read_vtkhdf},
                                          {".ngmesh", read_ngmesh}}};

const Format* format_of(const std::filesystem::path& path) {
    const std::string end = lower_extension(path);
    const auto* const found = std::find_if(kFormats.begin(), kFormats.end(),
                                           [&](const Format& f) { return end == f.extension; });
    return found == kFormats.end() ? nullptr : found;
}

}  // namespace

const std::byte* MeshBytes::at(std::uint64_t offset, std::uint64_t bytes) const {
    if (offset > size() || bytes > size() - offset) {
        fail(fmt::format("byte {}: {} more bytes are expected, but the file has {}", offset, bytes,
                         size()));
    }
    return file_.bytes().data() + offset;
}

void MeshBytes::fail(const std::string& problem) const {
    throw Error(ErrorKind::corrupt, {name_}, problem, {{RemedyKind::good_copy}});
}

PlyScratch::PlyScratch(const std::filesystem::path& folder, std::string name)
    : name_(std::move(name)),
      folder_(folder),
      vertex_rows_{ScratchFile(folder)},
      face_rows_{ScratchFile(folder)} {}

void PlyScratch::fail(const std::string& problem) const {
    throw Error(ErrorKind::corrupt, {name_}, problem, {{RemedyKind::good_copy}});
}

void PlyScratch::Rows::add(std::span<const std::byte> row) {
    buffer.insert(buffer.end(), row.begin(), row.end());
    if (buffer.size() >= kBuffer) {
        flush();
    }
}

void PlyScratch::Rows::flush() {
    file.write_at(written, buffer);
    written += buffer.size();
    buffer.clear();
}

void PlyScratch::vertex(const std::array<double, 3>& position, double value) {
    std::array<float, 4> row{};
    for (std::size_t a = 0; a < 3; ++a) {
        row.at(a) = static_cast<float>(position.at(a));
        if (!std::isfinite(row.at(a))) {
            fail(fmt::format("vertex {} has a coordinate that is not finite", vertices_));
        }
    }
    row[3] = static_cast<float>(value);
    has_values_ = has_values_ || !std::isnan(value);
    if (++vertices_ >= std::numeric_limits<std::uint32_t>::max()) {
        throw Error(ErrorKind::limit, {name_}, "has more than 2^32 vertices");
    }
    vertex_rows_.add(std::as_bytes(std::span(row)));
}

void PlyScratch::triangle(const std::array<std::uint64_t, 3>& corners) {
    std::array<std::byte, 13> row{std::byte{3}};
    for (std::size_t i = 0; i < 3; ++i) {
        largest_ = std::max(largest_, corners.at(i));
        const auto corner = static_cast<std::uint32_t>(corners.at(i));
        std::memcpy(row.data() + 1 + 4 * i, &corner, sizeof(corner));
    }
    ++triangles_;
    face_rows_.add(row);
}

ScratchFile PlyScratch::finish() {
    if (triangles_ > 0 && largest_ >= vertices_) {
        fail(fmt::format("a triangle refers to vertex {}, but there are {}", largest_, vertices_));
    }
    vertex_rows_.flush();
    face_rows_.flush();
    const std::string header = fmt::format(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\n"
        "property float y\nproperty float z\nproperty float {}\nelement face {}\n"
        "property list uchar uint vertex_indices\nend_header\n",
        vertices_, has_values_ ? "value" : "nothing", triangles_);
    ScratchFile ply(folder_);
    ply.write_at(0, std::as_bytes(std::span(header)));
    std::uint64_t at = header.size();
    std::vector<std::byte> buffer;
    for (Rows* const rows : {&vertex_rows_, &face_rows_}) {
        for (std::uint64_t from = 0; from < rows->written; from += buffer.size()) {
            buffer.resize(std::min<std::uint64_t>(kBuffer, rows->written - from));
            rows->file.read_at(from, buffer);
            ply.write_at(at, buffer);
            at += buffer.size();
        }
    }
    return ply;
}

/// 80 bytes of text, the number of triangles, and 50 bytes per triangle.
void read_stl(const std::filesystem::path& path, PlyScratch& to, Progress& progress) {
    const MeshBytes bytes(path);
    constexpr std::uint64_t kHeader = 84;
    constexpr std::uint64_t kRow = 50;
    const auto count = bytes.number<std::uint32_t>(80);
    if (bytes.size() != kHeader + kRow * count) {
        throw Error(
            ErrorKind::unsupported, {path.string()},
            fmt::format("{} bytes do not match a binary STL of {} triangles (text STL is not read)",
                        bytes.size(), count));
    }
    for (std::uint64_t i = 0; i < count; ++i) {
        if (i % 65536 == 0) {
            progress.check();
        }
        std::array<std::uint64_t, 3> corners{};
        for (std::uint64_t c = 0; c < 3; ++c) {
            const std::uint64_t at = kHeader + kRow * i + 12 + 12 * c;
            corners.at(c) = to.vertices();
            to.vertex(
                {bytes.number<float>(at), bytes.number<float>(at + 4), bytes.number<float>(at + 8)},
                NAN);
        }
        to.triangle(corners);
    }
}

void read_ngmesh(const std::filesystem::path& path, PlyScratch& to, Progress& progress) {
    const MeshBytes bytes(path);
    const std::uint64_t count = bytes.number<std::uint32_t>(0);
    for (std::uint64_t i = 0; i < count; ++i) {
        const std::uint64_t at = 4 + 12 * i;
        to.vertex(
            {bytes.number<float>(at), bytes.number<float>(at + 4), bytes.number<float>(at + 8)},
            NAN);
    }
    progress.check();
    const std::uint64_t begin = 4 + 12 * count;
    if ((bytes.size() - begin) % 12 != 0) {
        bytes.fail("its triangles are cut off");
    }
    for (std::uint64_t at = begin; at < bytes.size(); at += 12) {
        to.triangle({bytes.number<std::uint32_t>(at), bytes.number<std::uint32_t>(at + 4),
                     bytes.number<std::uint32_t>(at + 8)});
    }
}

PlyMesh open_mesh(const std::filesystem::path& path, const std::string& value,
                  const std::filesystem::path& folder, Progress& progress) {
    const Format* const format = format_of(path);
    if (format == nullptr) {
        return PlyMesh(path, value);
    }
    PlyScratch scratch(folder, path.string());
    format->read(path, scratch, progress);
    const ScratchFile ply = scratch.finish();
    return {ply.descriptor(), path, value};
}

// Text meshes: Wavefront OBJ, and the XML in 3MF.

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
        // Negative indices count back from the last vertex.
        const std::int64_t corner =
            number < 0 ? static_cast<std::int64_t>(to.vertices()) + number : number - 1;
        if (corner < 0) {
            to.fail(fmt::format("'{}' is not a vertex of a face", word));
        }
        corners.at(std::min<std::size_t>(count, 2)) = static_cast<std::uint64_t>(corner);
        if (count >= 2) {
            to.triangle(corners);
            corners[1] = corners[2];
        }
    }
}

/// A member of an archive, decompressed piece by piece.
class Inflated {
  public:
    Inflated(const std::filesystem::path& path, const ZipMember& member)
        : name_(path.string()), file_(path, std::ios::binary), member_(member) {
        file_.seekg(static_cast<std::streamoff>(member.start));
        if (inflateInit2(&stream_, -MAX_WBITS) != Z_OK) {
            throw Error(ErrorKind::limit, {name_}, "zlib is out of memory");
        }
    }
    Inflated(const Inflated&) = delete;
    Inflated& operator=(const Inflated&) = delete;
    ~Inflated() { inflateEnd(&stream_); }
    /// Appends to `text`; false at the end.
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
            throw Error(ErrorKind::corrupt, {name_, member_.name}, "cannot be decompressed",
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

/// The number in an attribute of a tag.
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

/// Reads a line without its end; of a line that is too long, the first kLongestLine + 1 characters.
/// False at the end of the file.
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
    // Opening a FIFO would hang.
    if (std::error_code ignored; std::filesystem::exists(path, ignored) &&
                                 !std::filesystem::is_regular_file(path, ignored)) {
        throw Error(ErrorKind::invalid_argument, {path.string()}, "not a regular file");
    }
    std::ifstream file(path);
    if (!file) {
        throw Error(ErrorKind::not_found, {path.string()}, "cannot open");
    }
    // Lines of a mesh that describe neither a vertex nor a face.
    constexpr std::array<std::string_view, 11> kOther{"",   "l",  "p",  "g",      "o",     "s",
                                                      "vt", "vn", "vp", "mtllib", "usemtl"};
    bool is_foreign = false;
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
                    to.fail(fmt::format("line {} is not a vertex", number));
                }
            }
            to.vertex(p, NAN);
        } else if (key == "f") {
            read_face(rest, to);
        } else if (!key.starts_with('#')) {
            is_foreign = is_foreign || std::find(kOther.begin(), kOther.end(), key) == kOther.end();
        }
    }
    if (to.vertices() == 0 && is_foreign) {
        to.fail("not an OBJ mesh: no line describes a vertex");
    }
}

/// Reads the first object: <vertex x y z/> and <triangle v1 v2 v3/>.
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
                        to.fail(fmt::format("{} is not a vertex of a triangle", corner));
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
