#include "preprocess/sources/nifti/nifti_format.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/far_objects.h"
#include "preprocess/sources/bytes/gzip_stream.h"
#include "preprocess/sources/bytes/header_number.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/regular_file.h"
#include "preprocess/sources/nifti/nifti_labels.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/wrapping/named_labels_source.h"
#include "preprocess/sources/wrapping/noted_source.h"
#include "preprocess/sources/wrapping/scaled_source.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kBytes1 = 348;
constexpr std::size_t kBytes2 = 540;

/// 1 or 2; 0 if it is none. `big`: the byte order of its numbers.
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

/// The start of a file, unpacked where it is gzip; empty if it cannot be read.
std::string head_of(const InputFile& file) {
    std::string text(VolumeInput::kHeadBytes, '\0');
    try {
        if (!is_gzip(file)) {
            return first_bytes(file, text.size());
        }
        GzipStream stream(file, file.name(), 0);
        text.resize(stream.read(reinterpret_cast<std::byte*>(text.data()), text.size()));
    } catch (const Error& error) {
        if (file.is_far() && error.kind() != ErrorKind::corrupt) {
            throw;  // what it is is not known
        }
        text.clear();
    }
    return text;
}

/// The names of a file beside another one: its ending, less ".gz", replaced by these.
std::vector<std::string> neighbours(const InputFile& named,
                                    std::initializer_list<const char*> endings) {
    std::filesystem::path path = named.is_far() ? std::filesystem::path(last_part_of(named.name()))
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

/// The first of these names that there is beside a file; none if there is none.
InputFile first_beside(const InputFile& file, const std::vector<std::string>& names) {
    for (const std::string& name : names) {
        if (!file.is_far()) {
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
            // S3 denies what is not there to those who may not list the bucket.
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

/// The file with the header: that of an image (.img, .img.gz) is its neighbour.
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

/// `named`: what the caller named, the header or the image. Where neither image is there, the
/// message is about the one that is not packed.
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

/// Of `xyzt_units`: the lowest three bits are the unit of length.
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
    constexpr std::int64_t kMostAxes = 7;
    if (dim(0) < 1 || dim(0) > kMostAxes) {
        throw Error(ErrorKind::corrupt, {name, "dim"}, fmt::format("{} axes", dim(0)));
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
                    fmt::format("{}: numbers of one scalar are read (integers of 8 to 64 bits, "
                                "float32, float64)",
                                datatype));
    }
}

/// The columns of the map from indices to places, and where the first voxel lies: by the
/// sform, else the qform, else the voxel's size alone.
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

/// Those in the header's extensions.
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
    // With another spacing the header's axes go.
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
