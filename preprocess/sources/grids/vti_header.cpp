// Source: https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html

#include "preprocess/sources/grids/vti_header.h"

#include <algorithm>
#include <utility>

#if ISONEST_WITH_EXPAT
#include <expat.h>
#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <map>
#include <memory>
#include <sstream>
#include <string_view>

#include <isonest/error.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"
#endif

#if ISONEST_WITH_EXPAT

namespace isonest::detail {
namespace {

constexpr std::size_t kPart = std::size_t{1} << 18U;
constexpr std::size_t kMaxArrays = 10000;
/// Each piece has an open file.
constexpr std::size_t kMaxImagePieces = 256;
constexpr int kMaxNested = 64;
/// Maximum bytes of a tag or comment, which expat holds as a whole, and of all array names.
constexpr std::uint64_t kMaxTag = std::uint64_t{4} << 20U;
/// Maximum bytes of a remote file that are read for its header.
constexpr std::uint64_t kMaxRemote = std::uint64_t{4} << 20U;

using Attributes = std::map<std::string, std::string, std::less<>>;

// The parser's position: expat 2.9 has these functions with 64-bit numbers on every machine, and
// deprecates the older ones.
#if XML_MAJOR_VERSION > 2 || (XML_MAJOR_VERSION == 2 && XML_MINOR_VERSION >= 9)
std::uint64_t line_number(XML_Parser parser) {
    return XML_GetCurrentLineNumber64(parser);
}
/// Negative if there is none.
std::int64_t byte_index(XML_Parser parser) {
    return XML_GetCurrentByteIndex64(parser);
}
std::uint64_t byte_count(XML_Parser parser) {
    return XML_GetCurrentByteCount64(parser);
}
#else
std::uint64_t line_number(XML_Parser parser) {
    return XML_GetCurrentLineNumber(parser);
}
/// Negative if there is none.
std::int64_t byte_index(XML_Parser parser) {
    return XML_GetCurrentByteIndex(parser);
}
std::uint64_t byte_count(XML_Parser parser) {
    return static_cast<std::uint64_t>(XML_GetCurrentByteCount(parser));
}
#endif

struct FreeParser {
    void operator()(XML_Parser parser) const { XML_ParserFree(parser); }
};

class VtiReader {
  public:
    explicit VtiReader(const InputFile& file) : file_(file), parser_(XML_ParserCreate(nullptr)) {
        if (!parser_) {
            throw std::bad_alloc();
        }
    }

    VtiHeader read() {
        XML_SetUserData(parser_.get(), this);
        XML_SetElementHandler(parser_.get(), &VtiReader::on_start, &VtiReader::on_end);
        const std::uint64_t size = regular_file_size(file_);
        for (std::uint64_t at = 0; at < size && !stopped_;) {
            if (file_.is_remote() && at - skipped_ > kMaxRemote) {
                throw Error(
                    ErrorKind::unsupported, {file_.name()},
                    "the data are inside the XML, so the whole object would be fetched twice",
                    {{RemedyKind::download}});
            }
            const std::string part = first_bytes(file_, kPart, at);
            at += part.size();
            const bool last = at >= size || part.empty();
            if (XML_Parse(parser_.get(), part.data(), static_cast<int>(part.size()), last) !=
                    XML_STATUS_OK &&
                !stopped_) {
                corrupt(XML_ErrorString(XML_GetErrorCode(parser_.get())));
            }
            if (last) {
                break;
            }
            const std::int64_t done = byte_index(parser_.get());
            if (!stopped_ &&
                (done < 0 || at - skipped_ - static_cast<std::uint64_t>(done) > kMaxTag)) {
                corrupt(fmt::format("a tag or comment has more than {} MiB", kMaxTag >> 20U));
            }
            const std::uint64_t end = stopped_ ? 0 : end_of_inline();
            if (end > at && end <= size) {
                skipped_ += end - at;
                at = end;
            }
        }
        if (!problem_.empty()) {
            throw Error(unsupported_ ? ErrorKind::unsupported : ErrorKind::corrupt,
                        {file_.name(), "VTI header"}, problem_);
        }
        if (!image_) {
            corrupt("there is no ImageData, RectilinearGrid or StructuredGrid element");
        }
        if (header_.pieces.empty()) {
            throw Error(ErrorKind::corrupt, {file_.name(), "VTI header"},
                        "there is no piece that has points");
        }
        if (!header_.encoding.empty()) {
            find_mark();
        }
        return header_;
    }

  private:
    [[noreturn]] void corrupt(const std::string& what) const {
        throw Error(ErrorKind::corrupt,
                    {file_.name(), fmt::format("line {}", line_number(parser_.get()))}, what);
    }
    /// An exception must not leave the parser's C code.
    void stop(const std::string& problem, bool unsupported = false) {
        problem_ = problem;
        unsupported_ = unsupported;
        stopped_ = true;
        XML_StopParser(parser_.get(), XML_FALSE);
    }

    static void on_start(void* self, const XML_Char* name, const XML_Char** given) {
        Attributes attributes;
        for (; given[0] != nullptr; given += 2) {
            attributes[given[0]] = given[1];
        }
        auto& reader = *static_cast<VtiReader*>(self);
        if (!reader.stopped_) {
            if (++reader.nested_ > kMaxNested) {
                return reader.stop(
                    fmt::format("elements are nested more than {} levels deep", kMaxNested));
            }
            reader.start(name, attributes);
        }
    }
    static void on_end(void* self, const XML_Char* name) {
        const std::string_view tag = name;
        auto& reader = *static_cast<VtiReader*>(self);
        --reader.nested_;
        if (tag == "PointData" || tag == "CellData" || tag == "Coordinates" || tag == "Points") {
            reader.section_.clear();
        }
        reader.inline_ = 0;
    }

    static std::string text(const Attributes& attributes, std::string_view key) {
        const auto it = attributes.find(key);
        return it == attributes.end() ? std::string() : it->second;
    }
    /// True if there is such an attribute with exactly N numbers.
    template <class T, std::size_t N>
    bool numbers(const Attributes& attributes, const char* key, std::array<T, N>& to) {
        const std::string all = text(attributes, key);
        if (all.empty()) {
            return false;
        }
        std::istringstream words(all);
        std::string word;
        for (T& number : to) {
            word.clear();
            words >> word;
            const auto [end, error] =
                std::from_chars(word.data(), word.data() + word.size(), number);
            if (error != std::errc{} || end != word.data() + word.size() ||
                !std::isfinite(static_cast<double>(number))) {
                stop(fmt::format("{} = '{:.80}' is not a list of {} numbers", key, all, N));
                return false;
            }
        }
        return true;
    }

    void start(const std::string& tag, const Attributes& attributes) {
        if (tag == "VTKFile") {
            const std::string type = text(attributes, "type");
            header_.rectilinear = type == "RectilinearGrid";
            header_.curved = type == "StructuredGrid";
            if (type != "ImageData" && !header_.rectilinear && !header_.curved) {
                return stop(fmt::format("the file type '{:.40}' is not supported; ImageData, "
                                        "RectilinearGrid and StructuredGrid are",
                                        type),
                            true);
            }
            header_.big_endian = text(attributes, "byte_order") == "BigEndian";
            header_.wide = text(attributes, "header_type") == "UInt64";
            header_.compressor = text(attributes, "compressor");
        } else if ((tag == "RectilinearGrid" && header_.rectilinear) ||
                   (tag == "StructuredGrid" && header_.curved)) {
            image_ = numbers(attributes, "WholeExtent", header_.extent);
        } else if (tag == "ImageData" && !header_.rectilinear && !header_.curved) {
            image_ = numbers(attributes, "WholeExtent", header_.extent);
            numbers(attributes, "Origin", header_.origin);
            numbers(attributes, "Spacing", header_.grid.spacing);
            numbers(attributes, "Direction", header_.grid.direction);
        } else if (tag == "Piece") {
            std::array<std::int64_t, 6> extent = header_.extent;
            numbers(attributes, "Extent", extent);
            add_piece(extent);
        } else if (tag == "PointData" || tag == "CellData" ||
                   (tag == "Coordinates" && header_.rectilinear) ||
                   (tag == "Points" && header_.curved)) {
            section_ = tag;
        } else if (tag == "DataArray" && !section_.empty() && !in_empty_piece_) {
            add_array(attributes);
        } else if (tag == "AppendedData") {
            header_.encoding = text(attributes, "encoding");
            header_.appended = behind_tag();
            stopped_ = true;
            XML_StopParser(parser_.get(), XML_FALSE);
        }
    }

    [[nodiscard]] std::uint64_t behind_tag() const {
        return skipped_ + static_cast<std::uint64_t>(byte_index(parser_.get())) +
               byte_count(parser_.get());
    }

    void add_piece(const std::array<std::int64_t, 6>& extent) {
        in_empty_piece_ = extent[1] < extent[0] || extent[3] < extent[2] || extent[5] < extent[4];
        if (in_empty_piece_) {
            return;
        }
        if (header_.pieces.size() >= kMaxImagePieces) {
            return stop(
                fmt::format("the image has more than {} pieces; in ParaView, save it as one",
                            kMaxImagePieces),
                true);
        }
        header_.pieces.push_back({extent, {}, {}});
    }

    void add_array(const Attributes& attributes) {
        if (header_.pieces.empty()) {
            header_.pieces.push_back({header_.extent, {}, {}});
        }
        VtiArray array;
        array.name = text(attributes, "Name");
        array.type = text(attributes, "type");
        array.format = text(attributes, "format");
        array.of_cells = section_ == "CellData";
        array.content = behind_tag();
        std::array<std::int64_t, 1> number{1};
        numbers(attributes, "NumberOfComponents", number);
        array.components = number[0];
        number = {0};
        numbers(attributes, "offset", number);
        array.offset = static_cast<std::uint64_t>(number[0]);
        if (array.components < 1 || number[0] < 0 || ++arrays_ > kMaxArrays) {
            return stop(fmt::format("invalid array '{:.80}': {} components at offset {}",
                                    array.name, array.components, number[0]));
        }
        name_bytes_ += array.name.size() + array.type.size() + array.format.size();
        if (name_bytes_ > kMaxTag) {
            return stop(
                fmt::format("the names of the arrays take more than {} MiB", kMaxTag >> 20U));
        }
        VtiPiece& piece = header_.pieces.back();
        (section_ == "Coordinates" || section_ == "Points" ? piece.coordinates : piece.arrays)
            .push_back(array);
        inline_ = array.format == "binary" && header_.compressor.empty() ? array.content : 0;
    }

    /// A position near the end of the inline base64 numbers of the current element, computed from
    /// the length before them; 0 if there are none or the length cannot be read. There are no tags
    /// before that position.
    std::uint64_t end_of_inline() {
        if (inline_ == 0) {
            return 0;
        }
        constexpr std::size_t kBlanks = 4096;
        constexpr std::size_t kLetters = 12;
        constexpr std::uint64_t kNear = 64;
        constexpr std::uint64_t kMax = std::uint64_t{1} << 60U;
        const std::uint64_t content = std::exchange(inline_, 0);
        const std::string text = first_bytes(file_, kBlanks + kLetters, content);
        const std::size_t blanks = std::min(text.find_first_not_of(" \t\r\n"), text.size());
        constexpr std::string_view kAlphabet =
            "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/=";
        const std::string letters = text.substr(blanks, kLetters);
        if (letters.size() < kLetters ||
            letters.find_first_not_of(kAlphabet) != std::string::npos) {
            return 0;
        }
        std::string word(sizeof(std::uint64_t), '\0');
        base64_bytes(file_, content + blanks, word.size())
            ->read(0, reinterpret_cast<std::byte*>(word.data()), word.size());
        const std::uint64_t bytes = header_.wide
                                        ? number_at<std::uint64_t>(word, 0, header_.big_endian)
                                        : number_at<std::uint32_t>(word, 0, header_.big_endian);
        return bytes > kMax ? 0 : content + blanks + std::max(bytes / 3 * 4, kNear) - kNear;
    }

    /// Appended data begin after an underscore.
    void find_mark() {
        constexpr std::size_t kBlanks = 4096;
        const std::string part = first_bytes(file_, kBlanks, header_.appended);
        const std::size_t mark = part.find_first_not_of(" \t\r\n");
        if (mark == std::string::npos || part[mark] != '_') {
            throw Error(ErrorKind::corrupt, {file_.name(), "AppendedData"},
                        "the data do not begin with an underscore");
        }
        header_.appended += mark + 1;
    }

    const InputFile& file_;
    std::unique_ptr<std::remove_pointer_t<XML_Parser>, FreeParser> parser_;
    VtiHeader header_;
    std::string section_;
    std::string problem_;
    bool unsupported_ = false;
    bool stopped_ = false;
    bool image_ = false;
    bool in_empty_piece_ = false;
    std::size_t arrays_ = 0;
    int nested_ = 0;
    std::uint64_t name_bytes_ = 0;
    std::uint64_t skipped_ = 0;  ///< bytes that were not passed to the parser
    std::uint64_t inline_ = 0;   ///< start of the element's base64 data; 0: none
};

}  // namespace

VtiHeader read_vti_header(const InputFile& file) {
    return VtiReader(file).read();
}

}  // namespace isonest::detail

#endif

namespace isonest::detail {
namespace {

/// Samples from `low` to `high`, excluding `high`.
struct Box {
    std::array<std::int64_t, 3> low{};
    std::array<std::int64_t, 3> high{};
};

Box box_of(const PieceBox& piece) {
    Box box{piece.low, piece.low};
    for (std::size_t i = 0; i < 3; ++i) {
        box.high.at(i) += piece.count.at(i);
    }
    return box;
}

/// The part of `box` that is not in `taken`, as up to six boxes.
void subtract(Box box, const Box& taken, std::vector<Box>& rest) {
    for (std::size_t i = 0; i < 3; ++i) {
        if (taken.high.at(i) <= box.low.at(i) || taken.low.at(i) >= box.high.at(i)) {
            rest.push_back(box);  // disjoint
            return;
        }
    }
    for (std::size_t i = 0; i < 3; ++i) {
        if (box.low.at(i) < taken.low.at(i)) {
            rest.push_back(box);
            rest.back().high.at(i) = box.low.at(i) = taken.low.at(i);
        }
        if (box.high.at(i) > taken.high.at(i)) {
            rest.push_back(box);
            rest.back().low.at(i) = box.high.at(i) = taken.high.at(i);
        }
    }
}

bool contains(const Box& outer, const Box& inner) {
    for (std::size_t i = 0; i < 3; ++i) {
        if (inner.low.at(i) < outer.low.at(i) || inner.high.at(i) > outer.high.at(i)) {
            return false;
        }
    }
    return true;
}

std::uint64_t volume_of(const std::array<std::int64_t, 3>& count) {
    return static_cast<std::uint64_t>(count[0]) * static_cast<std::uint64_t>(count[1]) *
           static_cast<std::uint64_t>(count[2]);
}

class JoinedPieces : public ByteReader {
  public:
    JoinedPieces(std::vector<PieceNumbers> pieces, const std::array<std::int64_t, 3>& image,
                 std::uint64_t sample_bytes)
        : pieces_(std::move(pieces)), image_(image), sample_(sample_bytes) {}
    [[nodiscard]] std::uint64_t size() const override { return volume_of(image_) * sample_; }
    [[nodiscard]] bool sequential() const override {
        return std::any_of(pieces_.begin(), pieces_.end(),
                           [](const PieceNumbers& p) { return p.numbers->sequential(); });
    }
    [[nodiscard]] std::uint64_t heap() const override {
        std::uint64_t all = 0;
        for (const PieceNumbers& piece : pieces_) {
            all += piece.numbers->heap();
        }
        return all;
    }
    void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        const std::uint64_t row = static_cast<std::uint64_t>(image_[0]) * sample_;
        while (bytes > 0) {
            const std::uint64_t n = std::min(bytes, row - at % row);
            read_row(static_cast<std::int64_t>(at / row), at % row, dst, n);
            at += n;
            dst += n;
            bytes -= n;
        }
    }

  private:
    /// Bytes [from, from + bytes) of a row.
    void read_row(std::int64_t row, std::uint64_t from, std::byte* dst, std::uint64_t bytes) {
        const std::int64_t y = row % image_[1];
        const std::int64_t z = row / image_[1];
        for (PieceNumbers& piece : pieces_) {
            const PieceBox& box = piece.box;
            const std::int64_t in_y = y - box.low[1];
            const std::int64_t in_z = z - box.low[2];
            const std::uint64_t begin = static_cast<std::uint64_t>(box.low[0]) * sample_;
            const std::uint64_t length = static_cast<std::uint64_t>(box.count[0]) * sample_;
            const std::uint64_t lo = std::max(begin, from);
            const std::uint64_t hi = std::min(begin + length, from + bytes);
            if (in_y < 0 || in_y >= box.count[1] || in_z < 0 || in_z >= box.count[2] || lo >= hi) {
                continue;
            }
            const auto rows = static_cast<std::uint64_t>(in_z * box.count[1] + in_y);
            piece.numbers->read(rows * length + lo - begin, dst + (lo - from), hi - lo);
        }
    }

    std::vector<PieceNumbers> pieces_;
    std::array<std::int64_t, 3> image_;
    std::uint64_t sample_;
};

}  // namespace

bool cover(const std::vector<PieceBox>& boxes, const std::array<std::int64_t, 3>& image) {
    constexpr std::size_t kMaxParts = 100000;
    std::vector<Box> open{{{}, image}};
    for (const PieceBox& box : boxes) {
        std::vector<Box> rest;
        for (const Box& part : open) {
            subtract(part, box_of(box), rest);
        }
        open = std::move(rest);
        if (open.size() > kMaxParts) {
            return false;
        }
    }
    return open.empty();
}

bool is_within_later(const std::vector<PieceBox>& boxes, std::size_t index) {
    return std::any_of(
        boxes.begin() + static_cast<std::ptrdiff_t>(index) + 1, boxes.end(),
        [&](const PieceBox& later) { return contains(box_of(later), box_of(boxes[index])); });
}

std::unique_ptr<ByteReader> join_pieces(std::vector<PieceNumbers> pieces,
                                        const std::array<std::int64_t, 3>& image,
                                        std::uint64_t sample_bytes) {
    return std::make_unique<JoinedPieces>(std::move(pieces), image, sample_bytes);
}

}  // namespace isonest::detail
