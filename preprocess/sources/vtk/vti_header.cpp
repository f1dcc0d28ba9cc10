// Source: https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
#if ISONEST_WITH_EXPAT
#include "preprocess/sources/vtk/vti_header.h"

#include <expat.h>
#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <map>
#include <memory>
#include <sstream>
#include <string_view>

#include <isonest/error.h>

#include "preprocess/sources/bytes/regular_file.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kPart = std::size_t{1} << 18U;
constexpr std::size_t kMostArrays = 10000;
/// Each has a file that is open.
constexpr std::size_t kMostImagePieces = 256;
constexpr int kMostNested = 64;
/// Of a tag or comment, which expat holds as a whole, and of the arrays' names together.
constexpr std::uint64_t kMostTag = std::uint64_t{4} << 20U;
/// Of a file elsewhere, how much is read for its header.
constexpr std::uint64_t kMostFar = std::uint64_t{4} << 20U;

using Attributes = std::map<std::string, std::string, std::less<>>;

// Where the parser is: expat 2.9 has these with numbers of 64 bits on every machine, and warns of
// the older ones.
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
            if (file_.is_far() && at > kMostFar) {
                throw Error(ErrorKind::unsupported, {file_.name()},
                            "its numbers stand within the XML, so that all of it would be fetched "
                            "twice",
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
            if (!stopped_ && (done < 0 || at - static_cast<std::uint64_t>(done) > kMostTag)) {
                corrupt(fmt::format("a tag or comment of more than {} MiB", kMostTag >> 20U));
            }
        }
        if (!problem_.empty()) {
            throw Error(unsupported_ ? ErrorKind::unsupported : ErrorKind::corrupt,
                        {file_.name(), "VTI header"}, problem_);
        }
        if (!image_) {
            corrupt("there is no ImageData");
        }
        if (header_.pieces.empty()) {
            throw Error(ErrorKind::corrupt, {file_.name(), "VTI header"},
                        "there is no piece with points in it");
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
    /// The parser's C code cannot be left by an exception.
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
            if (++reader.nested_ > kMostNested) {
                return reader.stop(fmt::format("elements lie more than {} deep", kMostNested));
            }
            reader.start(name, attributes);
        }
    }
    static void on_end(void* self, const XML_Char* name) {
        const std::string_view tag = name;
        auto& reader = *static_cast<VtiReader*>(self);
        --reader.nested_;
        if (tag == "PointData" || tag == "CellData") {
            reader.section_.clear();
        }
    }

    static std::string text(const Attributes& attributes, std::string_view key) {
        const auto it = attributes.find(key);
        return it == attributes.end() ? std::string() : it->second;
    }
    /// True if there is such an attribute, and it has that many numbers.
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
                stop(fmt::format("{} = '{:.80}' are not {} numbers", key, all, N));
                return false;
            }
        }
        return true;
    }

    void start(const std::string& tag, const Attributes& attributes) {
        if (tag == "VTKFile") {
            const std::string type = text(attributes, "type");
            if (type != "ImageData") {
                return stop(fmt::format("a file of type '{:.40}': ImageData is read", type), true);
            }
            header_.big_endian = text(attributes, "byte_order") == "BigEndian";
            header_.wide = text(attributes, "header_type") == "UInt64";
            header_.compressor = text(attributes, "compressor");
        } else if (tag == "ImageData") {
            image_ = numbers(attributes, "WholeExtent", header_.extent);
            numbers(attributes, "Origin", header_.origin);
            numbers(attributes, "Spacing", header_.grid.spacing);
            numbers(attributes, "Direction", header_.grid.direction);
        } else if (tag == "Piece") {
            std::array<std::int64_t, 6> extent = header_.extent;
            numbers(attributes, "Extent", extent);
            add_piece(extent);
        } else if (tag == "PointData" || tag == "CellData") {
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
        return static_cast<std::uint64_t>(byte_index(parser_.get())) + byte_count(parser_.get());
    }

    void add_piece(const std::array<std::int64_t, 6>& extent) {
        in_empty_piece_ = extent[1] < extent[0] || extent[3] < extent[2] || extent[5] < extent[4];
        if (in_empty_piece_) {
            return;
        }
        if (header_.pieces.size() >= kMostImagePieces) {
            return stop(
                fmt::format("more than {} pieces; in ParaView write it as one", kMostImagePieces),
                true);
        }
        header_.pieces.push_back({extent, {}});
    }

    void add_array(const Attributes& attributes) {
        if (header_.pieces.empty()) {
            header_.pieces.push_back({header_.extent, {}});
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
        if (array.components < 1 || number[0] < 0 || ++arrays_ > kMostArrays) {
            return stop(fmt::format("array '{:.80}' with {} components at offset {}", array.name,
                                    array.components, number[0]));
        }
        name_bytes_ += array.name.size() + array.type.size() + array.format.size();
        if (name_bytes_ > kMostTag) {
            return stop(fmt::format("names of arrays of more than {} MiB", kMostTag >> 20U));
        }
        header_.pieces.back().arrays.push_back(array);
    }

    /// Appended data begin behind an underscore.
    void find_mark() {
        constexpr std::size_t kBlanks = 4096;
        const std::string part = first_bytes(file_, kBlanks, header_.appended);
        const std::size_t mark = part.find_first_not_of(" \t\r\n");
        if (mark == std::string::npos || part[mark] != '_') {
            throw Error(ErrorKind::corrupt, {file_.name(), "AppendedData"},
                        "it does not begin with an underscore");
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
};

}  // namespace

VtiHeader read_vti_header(const InputFile& file) {
    return VtiReader(file).read();
}

}  // namespace isonest::detail
#endif
