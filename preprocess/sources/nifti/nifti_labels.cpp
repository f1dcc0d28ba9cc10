#include "preprocess/sources/nifti/nifti_labels.h"

#if ISONEST_WITH_EXPAT
#include <expat.h>
#endif
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "preprocess/sources/bytes/gzip_stream.h"
#include "preprocess/sources/bytes/header_number.h"
#include "preprocess/sources/bytes/regular_file.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kMostExtensionBytes = std::uint64_t{1} << 24U;

/// Bytes [begin, end) of the unpacked file, or fewer where it ends.
std::string unpacked_bytes(const InputFile& file, std::uint64_t begin, std::uint64_t end) {
    if (!is_gzip(file)) {
        return first_bytes(file, static_cast<std::size_t>(end - begin), begin);
    }
    GzipStream stream(file, file.name(), 0);
    std::string text(static_cast<std::size_t>(end), '\0');
    text.resize(stream.read(reinterpret_cast<std::byte*>(text.data()), text.size()));
    return text.substr(std::min<std::size_t>(begin, text.size()));
}

#if ISONEST_WITH_EXPAT
template <class T>
bool read_number(std::string_view text, T& value) {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc{} && end == text.data() + text.size() && !text.empty();
}

class CaretReader {
  public:
    CaretReader(std::int64_t volume, FoundLabels& labels)
        : volume_(volume), labels_(labels), parser_(XML_ParserCreate(nullptr)) {
        if (!parser_) {
            throw std::bad_alloc();
        }
    }
    /// What is wrong; empty if nothing is.
    std::string read(const std::string& xml) {
        // What expat keeps grows with the number of tags and attributes, and with their depth.
        if (std::count(xml.begin(), xml.end(), '<') > kMostTags ||
            std::count(xml.begin(), xml.end(), '=') > kMostAttributes) {
            return "it has more than the names of labels";
        }
        XML_SetUserData(parser_.get(), this);
        XML_SetElementHandler(parser_.get(), &CaretReader::on_start, &CaretReader::on_end);
        XML_SetCharacterDataHandler(parser_.get(), &CaretReader::on_text);
        XML_SetStartDoctypeDeclHandler(parser_.get(), &CaretReader::on_doctype);
        const bool read =
            XML_Parse(parser_.get(), xml.data(), static_cast<int>(xml.size()), 1) == XML_STATUS_OK;
        return read                  ? ""
               : doctype_            ? "it declares entities"
               : depth_ > kMostDepth ? "it is nested too deeply"
                                     : XML_ErrorString(XML_GetErrorCode(parser_.get()));
    }

  private:
    static constexpr int kMostDepth = 32;
    /// A label has two tags and six attributes; beside them there is little.
    static constexpr std::ptrdiff_t kMostTags = 4 * std::ptrdiff_t{LabelName::kMostOfStore};
    static constexpr std::ptrdiff_t kMostAttributes = 8 * std::ptrdiff_t{LabelName::kMostOfStore};

    struct FreeCaretParser {
        void operator()(XML_Parser parser) const { XML_ParserFree(parser); }
    };
    static std::string_view attribute(const XML_Char** given, std::string_view name) {
        for (; given[0] != nullptr; given += 2) {
            if (name == given[0]) {
                return given[1];
            }
        }
        return {};
    }
    static void on_doctype(void* self, const XML_Char* /*name*/, const XML_Char* /*system*/,
                           const XML_Char* /*public_id*/, int /*internal*/) {
        auto& reader = *static_cast<CaretReader*>(self);
        reader.doctype_ = true;
        XML_StopParser(reader.parser_.get(), XML_FALSE);
    }
    static void on_start(void* self, const XML_Char* name, const XML_Char** given) {
        auto& reader = *static_cast<CaretReader*>(self);
        const std::string_view tag = name;
        if (++reader.depth_ > kMostDepth) {
            XML_StopParser(reader.parser_.get(), XML_FALSE);
            return;
        }
        if (tag == "VolumeInformation") {
            reader.current_ = 0;
            read_number(attribute(given, "Index"), reader.current_);
        } else if (tag == "LabelTable") {
            reader.in_table_ = reader.current_ == reader.volume_;
        } else if (tag == "Label" && reader.in_table_) {
            reader.start_label(given);
        }
    }
    static void on_text(void* self, const XML_Char* text, int size) {
        auto& reader = *static_cast<CaretReader*>(self);
        // A longer one is left out, by its length.
        if (reader.in_label_ && reader.text_.size() <= 2 * LabelName::kMostBytes) {
            reader.text_.append(text, static_cast<std::size_t>(size));
        }
    }
    static void on_end(void* self, const XML_Char* name) {
        auto& reader = *static_cast<CaretReader*>(self);
        const std::string_view tag = name;
        --reader.depth_;
        if (tag == "LabelTable") {
            reader.in_table_ = false;
        } else if (tag == "Label" && reader.in_label_) {
            reader.in_label_ = false;
            reader.labels_.add(reader.id_, reader.text_, reader.color_);
        }
    }

    void start_label(const XML_Char** given) {
        in_label_ = read_number(attribute(given, "Key"), id_);
        text_.clear();
        color_.reset();
        if (!in_label_) {
            labels_.leave_out("a label whose Key is no whole number");
            return;
        }
        double red = -1;
        double green = -1;
        double blue = -1;
        if (attribute(given, "Red").empty() && attribute(given, "Green").empty() &&
            attribute(given, "Blue").empty()) {
            return;
        }
        if (read_number(attribute(given, "Red"), red) &&
            read_number(attribute(given, "Green"), green) &&
            read_number(attribute(given, "Blue"), blue)) {
            color_ = color_of_parts(red, green, blue);
        }
        if (!color_) {
            labels_.leave_out(
                fmt::format("label {}: its colour is not three numbers from 0 to 1", id_));
        }
    }

    std::int64_t volume_;
    FoundLabels& labels_;
    std::unique_ptr<std::remove_pointer_t<XML_Parser>, FreeCaretParser> parser_;
    std::int64_t current_ = 0;  ///< whose information this is
    bool in_table_ = false;     ///< of the volume
    bool in_label_ = false;
    bool doctype_ = false;
    int depth_ = 0;
    std::int64_t id_ = 0;
    std::string text_;
    std::optional<LabelColor> color_;
};

void read_caret(const std::string& xml, std::int64_t volume, FoundLabels& labels) {
    FoundLabels found;
    if (const std::string why = CaretReader(volume, found).read(xml); !why.empty()) {
        labels.leave_out("Caret's XML: " + why);
        return;
    }
    labels = std::move(found);
}
#else
void read_caret(const std::string& /*xml*/, std::int64_t /*volume*/, FoundLabels& labels) {
    labels.leave_out("Caret's XML, which isonest reads if it is built with libexpat1-dev");
}
#endif

}  // namespace

FoundLabels labels_of_nifti(const NiftiExtensions& where, std::int64_t volume) {
    constexpr std::size_t kHead = 4;
    constexpr std::size_t kEntryHead = 8;
    constexpr int kCaret = 30;
    FoundLabels labels;
    const std::uint64_t end = std::min(where.end, where.begin + kMostExtensionBytes);
    if (end < where.begin + kHead + kEntryHead) {
        return labels;
    }
    const std::string bytes = unpacked_bytes(where.file, where.begin, end);
    if (bytes.size() < kHead + kEntryHead || bytes[0] == 0) {
        return labels;
    }
    for (std::size_t at = kHead; at + kEntryHead <= bytes.size();) {
        const auto size = number_at<std::int32_t>(bytes, at, where.big_endian);
        const auto code = number_at<std::int32_t>(bytes, at + 4, where.big_endian);
        if (size < static_cast<std::int32_t>(kEntryHead) ||
            static_cast<std::size_t>(size) > bytes.size() - at) {
            break;
        }
        const std::string content =
            trimmed(bytes.substr(at + kEntryHead, static_cast<std::size_t>(size) - kEntryHead));
        const bool caret = content.starts_with('<') &&
                           content.find("<CaretExtension") != std::string::npos &&
                           content.find("<LabelTable") != std::string::npos;
        if ((code == kCaret || code == 0) && caret) {
            read_caret(content, volume, labels);
            break;
        }
        at += static_cast<std::size_t>(size);
    }
    return labels;
}

}  // namespace isonest::detail
