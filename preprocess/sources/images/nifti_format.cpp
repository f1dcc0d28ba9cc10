#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/remote_objects.h"
#include "preprocess/sources/bytes/stream_bytes.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/label_names.h"
#include "preprocess/sources/wrapping/scaled_source.h"

#if ISONEST_WITH_EXPAT
#include <expat.h>
#endif

namespace isonest::detail {

// Names and colours of labels in the extensions of a NIfTI header.

/// Where the extensions of a header are, in the decompressed file.
struct NiftiExtensions {
    InputFile file;
    std::uint64_t begin = 0;  ///< of the four bytes that say whether there are extensions
    std::uint64_t end = 0;    ///< of the numbers, unless the file ends before
    bool big_endian = false;
};

/// The <LabelTable> of Caret's XML for volume number `volume` of the file (the fourth axis).
/// Connectome Workbench writes it as an extension with code 30, others with code 0. Unreadable
/// parts are left out, with a note. The search ends at an extension with an impossible size, and at
/// 16 MiB.
/// Sources:
/// https://nifti.nimh.nih.gov/nifti-1/documentation/nifti1fields/nifti1fields_pages/extension.html,
/// https://www.nitrc.org/projects/cifti (the element LabelTable).
/// Throws Error{io}, and Error{corrupt} for damaged gzip data there.
FoundLabels labels_of_nifti(const NiftiExtensions& where, std::int64_t volume);

namespace {

constexpr std::uint64_t kMaxExtensionBytes = std::uint64_t{1} << 24U;

/// Bytes [begin, end) of the decompressed file, or fewer if it ends before.
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
    /// Returns what is wrong; empty if nothing is.
    std::string read(const std::string& xml) {
        // The memory of expat grows with the number of tags and attributes, and with their depth.
        if (std::count(xml.begin(), xml.end(), '<') > kMaxTags ||
            std::count(xml.begin(), xml.end(), '=') > kMaxAttributes) {
            return "it has more tags than label names need";
        }
        XML_SetUserData(parser_.get(), this);
        XML_SetElementHandler(parser_.get(), &CaretReader::on_start, &CaretReader::on_end);
        XML_SetCharacterDataHandler(parser_.get(), &CaretReader::on_text);
        XML_SetStartDoctypeDeclHandler(parser_.get(), &CaretReader::on_doctype);
        const bool read =
            XML_Parse(parser_.get(), xml.data(), static_cast<int>(xml.size()), 1) == XML_STATUS_OK;
        return read                 ? ""
               : doctype_           ? "it declares entities"
               : depth_ > kMaxDepth ? "it is nested too deeply"
                                    : XML_ErrorString(XML_GetErrorCode(parser_.get()));
    }

  private:
    static constexpr int kMaxDepth = 32;
    /// A label has two tags and six attributes; there is little else.
    static constexpr std::ptrdiff_t kMaxTags = 4 * std::ptrdiff_t{LabelName::kMaxOfStore};
    static constexpr std::ptrdiff_t kMaxAttributes = 8 * std::ptrdiff_t{LabelName::kMaxOfStore};

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
        if (++reader.depth_ > kMaxDepth) {
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
        // A longer text is left out later because of its length.
        if (reader.in_label_ && reader.text_.size() <= 2 * LabelName::kMaxBytes) {
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
            labels_.leave_out("a label whose Key is not a whole number");
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
    std::int64_t current_ = 0;  ///< the volume that the current information is about
    bool in_table_ = false;     ///< in the table of the wanted volume
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
        labels.leave_out("Caret XML: " + why);
        return;
    }
    labels = std::move(found);
}
#else
void read_caret(const std::string& /*xml*/, std::int64_t /*volume*/, FoundLabels& labels) {
    labels.leave_out("Caret XML, which needs a build of isonest with libexpat1-dev");
}
#endif

}  // namespace

FoundLabels labels_of_nifti(const NiftiExtensions& where, std::int64_t volume) {
    constexpr std::size_t kHead = 4;
    constexpr std::size_t kEntryHead = 8;
    constexpr int kCaret = 30;
    FoundLabels labels;
    const std::uint64_t end = std::min(where.end, where.begin + kMaxExtensionBytes);
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

namespace {

constexpr std::size_t kBytes1 = 348;
constexpr std::size_t kBytes2 = 540;

/// 1 or 2; 0 if the file is not NIfTI. `big`: the byte order of its numbers.
int version_of(std::string_view head, bool& big) {
    for (const bool order : {false, true}) {
        big = order;
        if (head.size() >= kBytes1 &&
            number_at<std::int32_t>(head, 0, order) == static_cast<std::int32_t>(kBytes1) &&
            (head.substr(344, 4) == std::string_view("n+1\0", 4) ||
             head.substr(344, 4) == std::string_view("ni1\0", 4))) {
            return 1;
        }
        if (head.size() >= kBytes2 &&
            number_at<std::int32_t>(head, 0, order) == static_cast<std::int32_t>(kBytes2) &&
            (head.substr(4, 4) == std::string_view("n+2\0", 4) ||
             head.substr(4, 4) == std::string_view("ni2\0", 4))) {
            return 2;
        }
    }
    return 0;
}

/// The start of a file, decompressed if it is gzip; empty if it cannot be read.
std::string head_of(const InputFile& file) {
    std::string text(VolumeInput::kHeadBytes, '\0');
    try {
        if (!is_gzip(file)) {
            return first_bytes(file, text.size());
        }
        GzipStream stream(file, file.name(), 0);
        text.resize(stream.read(reinterpret_cast<std::byte*>(text.data()), text.size()));
    } catch (const Error& error) {
        if (file.is_remote() && error.kind() != ErrorKind::corrupt) {
            throw;  // the format is unknown
        }
        text.clear();
    }
    return text;
}

/// The names of files beside another one: its extension, without ".gz", replaced by these.
std::vector<std::string> neighbours(const InputFile& named,
                                    std::initializer_list<const char*> endings) {
    std::filesystem::path path = named.is_remote()
                                     ? std::filesystem::path(last_part_of(named.name()))
                                     : named.path().filename();
    if (path.extension() == ".gz") {
        path.replace_extension();
    }
    const std::string stem = path.replace_extension().string();
    std::vector<std::string> names;
    for (const char* const ending : endings) {
        names.push_back(stem + ending);
    }
    return names;
}

/// The first existing file beside `file` with one of these names; empty if there is none.
InputFile first_beside(const InputFile& file, const std::vector<std::string>& names) {
    for (const std::string& name : names) {
        if (!file.is_remote()) {
            std::error_code error;
            InputFile there = file.beside(name);
            if (std::filesystem::is_regular_file(there.path(), error)) {
                return there;
            }
            continue;
        }
        try {
            return file.beside(name);
        } catch (const Error& error) {
            // S3 denies access to missing objects unless the caller may list the bucket.
            const bool is_denied =
                std::any_of(error.remedies().begin(), error.remedies().end(),
                            [](const Remedy& r) { return r.kind == RemedyKind::give_credentials; });
            if (error.kind() != ErrorKind::not_found && !is_denied) {
                throw;
            }
        }
    }
    return {};
}

/// The file with the header: for an image (.img, .img.gz), the one beside it.
InputFile header_file(const InputFile& named) {
    std::filesystem::path path = named.path();
    if (path.extension() == ".gz") {
        path.replace_extension();
    }
    if (path.extension() != ".img") {
        return named;
    }
    InputFile header = first_beside(named, neighbours(named, {".hdr", ".hdr.gz"}));
    return header.empty() ? named : header;
}

/// `named`: the file given by the caller, the header or the image. If neither image exists, the
/// message is about the uncompressed one.
InputFile image_file(const InputFile& header, const InputFile& named) {
    if (named.path() != header.path()) {
        return named;
    }
    const std::vector<std::string> names = neighbours(header, {".img", ".img.gz"});
    InputFile image = first_beside(header, names);
    return image.empty() ? header.beside(names.front()) : image;
}

bool is_nifti(const VolumeInput& input) {
    if (input.folder) {
        return false;
    }
    bool big = false;
    if (version_of(input.unpacked, big) != 0) {
        return true;
    }
    const InputFile header = header_file(input.file);
    return header.path() != input.file.path() && version_of(head_of(header), big) != 0;
}

struct NiftiHeader {
    bool big = false;
    bool single = true;  ///< header and image in one file
    std::vector<std::int64_t> dims;
    std::vector<double> pixdim;
    int datatype = 0;
    double offset = 0;
    double slope = 0;
    double intercept = 0;
    int qform = 0;
    int sform = 0;
    std::array<double, 6> quaternion{};  ///< b, c, d and the offset
    std::array<double, 12> rows{};
    std::optional<LengthUnit> unit;
};

/// The lowest three bits of `xyzt_units` are the unit of length.
std::optional<LengthUnit> unit_of_code(int code) {
    switch (code & 7) {
        case 1:
            return LengthUnit::metre;
        case 2:
            return LengthUnit::millimetre;
        case 3:
            return LengthUnit::micrometre;
        default:
            return std::nullopt;
    }
}

NiftiHeader parse(std::string_view head, const std::string& name) {
    NiftiHeader h;
    const int version = version_of(head, h.big);
    const auto real = [&](std::size_t at1, std::size_t at2, std::size_t i) {
        return version == 1 ? static_cast<double>(number_at<float>(head, at1 + 4 * i, h.big))
                            : number_at<double>(head, at2 + 8 * i, h.big);
    };
    const auto whole = [&](std::size_t at1, std::size_t at2) -> std::int64_t {
        return version == 1 ? number_at<std::int16_t>(head, at1, h.big)
                            : number_at<std::int32_t>(head, at2, h.big);
    };
    h.single = head[version == 1 ? 345 : 5] == '+';
    const auto dim = [&](std::size_t i) -> std::int64_t {
        return version == 1 ? number_at<std::int16_t>(head, 40 + 2 * i, h.big)
                            : number_at<std::int64_t>(head, 16 + 8 * i, h.big);
    };
    constexpr std::int64_t kMaxAxes = 7;
    if (dim(0) < 1 || dim(0) > kMaxAxes) {
        throw Error(ErrorKind::corrupt, {name, "dim"},
                    fmt::format("{} is not a number of axes from 1 to 7", dim(0)));
    }
    for (std::size_t i = 1; i <= static_cast<std::size_t>(dim(0)); ++i) {
        h.dims.push_back(dim(i));
    }
    for (std::size_t i = 0; i < 8; ++i) {
        h.pixdim.push_back(real(76, 104, i));
    }
    h.datatype = version == 1 ? number_at<std::int16_t>(head, 70, h.big)
                              : number_at<std::int16_t>(head, 12, h.big);
    h.offset = version == 1 ? static_cast<double>(number_at<float>(head, 108, h.big))
                            : static_cast<double>(number_at<std::int64_t>(head, 168, h.big));
    h.slope = real(112, 176, 0);
    h.intercept = real(112, 176, 1);
    h.qform = static_cast<int>(whole(252, 344));
    h.sform = static_cast<int>(whole(254, 348));
    for (std::size_t i = 0; i < 6; ++i) {
        h.quaternion.at(i) = real(256, 352, i);
    }
    for (std::size_t i = 0; i < 12; ++i) {
        h.rows.at(i) = real(280, 400, i);
    }
    h.unit = unit_of_code(version == 1 ? head[123] : number_at<std::int32_t>(head, 500, h.big));
    return h;
}

void set_type(int datatype, const std::string& name, PlacedArray& array) {
    static const std::map<int, ValueType> types{
        {2, ValueType::u8},   {4, ValueType::i16},  {8, ValueType::i32},   {16, ValueType::f32},
        {64, ValueType::f64}, {256, ValueType::i8}, {512, ValueType::u16}, {768, ValueType::u32}};
    constexpr int kInt64 = 1024;
    constexpr int kUint64 = 1280;
    if (const auto it = types.find(datatype); it != types.end()) {
        array.layout.type = it->second;
    } else if (datatype == kInt64 || datatype == kUint64) {
        array.stored = datatype == kInt64 ? StoredNumber::i64 : StoredNumber::u64;
    } else {
        throw Error(ErrorKind::unsupported, {name, "datatype"},
                    fmt::format("{} is not supported; one scalar per voxel is (integers of 8 to 64 "
                                "bits, float32, float64)",
                                datatype));
    }
}

/// Sets the columns of the map from indices to positions, and the position of the first voxel: from
/// the sform; otherwise from the qform; otherwise only from the voxel size.
void set_place(const NiftiHeader& h, PlacedArray& array) {
    std::array<Double3, 3> columns{};
    if (h.sform > 0) {
        for (std::size_t a = 0; a < 3; ++a) {
            columns.at(a) = {h.rows.at(a), h.rows.at(4 + a), h.rows.at(8 + a)};
        }
        array.first = {h.rows[3], h.rows[7], h.rows[11]};
    } else if (h.qform > 0) {
        const double b = h.quaternion[0];
        const double c = h.quaternion[1];
        const double d = h.quaternion[2];
        const double a = std::sqrt(std::max(0.0, 1 - (b * b + c * c + d * d)));
        const double side = h.pixdim[0] < 0 ? -1 : 1;
        columns = {{{a * a + b * b - c * c - d * d, 2 * (b * c + a * d), 2 * (b * d - a * c)},
                    {2 * (b * c - a * d), a * a + c * c - b * b - d * d, 2 * (c * d + a * b)},
                    {2 * (b * d + a * c), 2 * (c * d - a * b), a * a + d * d - b * b - c * c}}};
        for (std::size_t i = 0; i < 3; ++i) {
            for (double& component : columns.at(i)) {
                component *= h.pixdim[i + 1] * (i == 2 ? side : 1);
            }
        }
        array.first = {h.quaternion[3], h.quaternion[4], h.quaternion[5]};
    } else {
        for (std::size_t a = 0; a < 3; ++a) {
            columns.at(a).at(a) = h.pixdim[a + 1] > 0 ? h.pixdim[a + 1] : 1;
        }
    }
    array.steps.assign(array.axes.size(), Double3{0, 0, 0});
    for (std::size_t i = array.axes.size(); i-- > 0;) {
        array.apart.push_back(h.pixdim[i + 1]);
    }
    for (std::size_t a = 0; a < std::min<std::size_t>(3, array.axes.size()); ++a) {
        array.steps[array.axes.size() - 1 - a] = columns.at(a);
    }
}

/// The labels in the header's extensions.
FoundLabels labels_of(const NiftiHeader& h, const InputFile& header, bool first,
                      const PlacedArray& array, std::span<const AxisIndex> index) {
    constexpr std::size_t kTime = 4;  // the fourth axis from the end of the list
    const ChosenAxes chosen = choose_axes(array.axes, index, array.name);
    const std::int64_t volume = chosen.at.size() < kTime ? 0 : chosen.at[chosen.at.size() - kTime];
    const std::uint64_t begin = first ? kBytes1 : kBytes2;
    const std::uint64_t end =
        h.single ? static_cast<std::uint64_t>(h.offset) : std::numeric_limits<std::uint64_t>::max();
    return labels_of_nifti({header, begin, end, h.big}, volume);
}

std::unique_ptr<VolumeSource> open_nifti(const VolumeInput& input, const SourceOptions& options) {
    const InputFile header = header_file(input.file);
    const std::string name = header.name();
    const std::string head = header.path() == input.file.path() ? input.unpacked : head_of(header);
    const NiftiHeader h = parse(head, name);
    PlacedArray array;
    array.name = name;
    array.file = h.single ? header : image_file(header, input.file);
    if (!h.single) {
        array.layout.header = header;
        array.name = array.file.name();
    }
    const std::size_t least = h.single ? kBytes1 : 0;
    if (!(h.offset >= static_cast<double>(least)) || h.offset > 1e15 ||
        h.offset != std::floor(h.offset)) {
        throw Error(ErrorKind::corrupt, {name, "vox_offset"},
                    fmt::format("the image cannot begin at byte {}", h.offset));
    }
    constexpr std::array<const char*, 7> kNames{"x", "y", "z", "t", "u", "v", "w"};
    for (std::size_t i = h.dims.size(); i-- > 0;) {
        array.axes.push_back({kNames.at(i), h.dims[i], i < 3});
    }
    array.layout.offset = static_cast<std::uint64_t>(h.offset);
    array.layout.big_endian = h.big;
    array.layout.unit = h.unit;
    array.layout.exact_length = false;
    set_type(h.datatype, name, array);
    set_place(h, array);
    array.own_spacing = options.spacing.has_value();
    // A new spacing replaces the header's axes.
    if (!options.spacing) {
        array.layout.frame =
            h.sform > 0 || h.qform > 0 ? AnatomicalFrame::ras : AnatomicalFrame::unknown;
    }
    auto source = open_placed(array, options.index);
    if (h.slope != 0 && std::isfinite(h.slope)) {
        source = scaled(std::move(source), {.slope = h.slope, .intercept = h.intercept});
    }
    if (options.labels) {
        bool big = false;
        const FoundLabels labels =
            labels_of(h, header, version_of(head, big) == 1, array, options.index);
        source = with_label_names(with_notes(std::move(source), labels.notes()), labels.names());
    }
    return source;
}

}  // namespace

VolumeFormat nifti_format() {
    return {.about = {"NIfTI", ".nii .nii.gz .hdr .img", ""},
            .takes = {.index = true},
            .reads_urls = true,
            .recognises = is_nifti,
            .open = open_nifti};
}

}  // namespace isonest::detail
