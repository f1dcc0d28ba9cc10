#include "store/exports/volume_headers.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string_view>

#include "store/container/header_writer.h"

namespace isonest::detail {
namespace {

/// The word of a list in the order of ValueType, with int64 behind.
template <class Word>
Word word_of(const VolumeFileSpec& spec, const std::array<Word, 9>& words) {
    return spec.is_int64 ? words.back() : words.at(static_cast<std::size_t>(spec.type));
}

template <class T>
void put(std::string& header, std::size_t at, T value) {
    std::memcpy(header.data() + at, &value, sizeof(value));
}

/// The same place in another frame, where both are known.
VolumeFileSpec in_frame(VolumeFileSpec spec, AnatomicalFrame frame) {
    if (sign_between(spec.frame, frame) < 0) {
        for (std::size_t w = 0; w < 2; ++w) {
            spec.origin.at(w) = 0 - spec.origin.at(w);
            for (Double3& axis : spec.direction) {
                axis.at(w) = 0 - axis.at(w);  // no -0
            }
        }
        spec.frame = frame;
    }
    return spec;
}

/// NIfTI's quaternion b, c, d of a rotation; a >= 0 follows from them. The largest of the four is
/// found first, so that none is divided by a small one.
/// Source:
/// https://nifti.nimh.nih.gov/nifti-1/documentation/nifti1fields/nifti1fields_pages/quatern.html
std::array<double, 3> nifti_quaternion(const Directions& axes) {
    const auto r = [&axes](std::size_t row, std::size_t column) { return axes.at(column).at(row); };
    const std::array<double, 4> squares{
        1 + r(0, 0) + r(1, 1) + r(2, 2), 1 + r(0, 0) - r(1, 1) - r(2, 2),
        1 - r(0, 0) + r(1, 1) - r(2, 2), 1 - r(0, 0) - r(1, 1) + r(2, 2)};
    const auto largest = static_cast<std::size_t>(std::max_element(squares.begin(), squares.end()) -
                                                  squares.begin());
    const double twice = std::sqrt(squares.at(largest));
    const double a = largest == 0   ? twice / 2
                     : largest == 1 ? (r(2, 1) - r(1, 2)) / (2 * twice)
                     : largest == 2 ? (r(0, 2) - r(2, 0)) / (2 * twice)
                                    : (r(1, 0) - r(0, 1)) / (2 * twice);
    const std::array<double, 3> found =
        largest == 0   ? std::array<double, 3>{(r(2, 1) - r(1, 2)) / (2 * twice),
                                               (r(0, 2) - r(2, 0)) / (2 * twice),
                                               (r(1, 0) - r(0, 1)) / (2 * twice)}
        : largest == 1 ? std::array<double, 3>{twice / 2, (r(1, 0) + r(0, 1)) / (2 * twice),
                                               (r(0, 2) + r(2, 0)) / (2 * twice)}
        : largest == 2 ? std::array<double, 3>{(r(1, 0) + r(0, 1)) / (2 * twice), twice / 2,
                                               (r(2, 1) + r(1, 2)) / (2 * twice)}
                       : std::array<double, 3>{(r(0, 2) + r(2, 0)) / (2 * twice),
                                               (r(2, 1) + r(1, 2)) / (2 * twice), twice / 2};
    // Of length 1, so that what the header says of the fourth is no root of a number below 0.
    const double length =
        std::sqrt(a * a + found[0] * found[0] + found[1] * found[1] + found[2] * found[2]);
    const double scale = (a < 0 ? -1 : 1) / length;
    return {found[0] * scale, found[1] * scale, found[2] * scale};
}

/// From which side of a patient to which other one each axis runs, by the first side's letter, as
/// ITK writes it: each axis along the world's axis that it is nearest to and no axis before it has.
std::string meta_image_orientation(const VolumeFileSpec& in_lps) {
    if (in_lps.frame != AnatomicalFrame::lps) {
        return "???";
    }
    constexpr std::array<std::string_view, 3> kSides{"RL", "AP", "IS"};
    std::array<bool, 3> taken{};
    std::string letters;
    for (const Double3& axis : in_lps.direction) {
        std::size_t nearest = 3;
        for (std::size_t w = 0; w < 3; ++w) {
            if (!taken.at(w) &&
                (nearest == 3 || std::fabs(axis.at(w)) > std::fabs(axis.at(nearest)))) {
                nearest = w;
            }
        }
        taken.at(nearest) = true;
        letters += kSides.at(nearest)[axis.at(nearest) < 0 ? 1 : 0];
    }
    return letters;
}

/// The world's vector from a node to the next along an axis.
Double3 step(const VolumeFileSpec& spec, std::size_t axis) {
    Double3 v = spec.direction.at(axis);
    for (double& component : v) {
        component *= spec.spacing.at(axis);
    }
    return v;
}

/// NIfTI's number of a unit; 0 for what it does not have.
char nifti_unit(const VolumeFileSpec& spec) {
    return spec.unit == LengthUnit::metre        ? 1
           : spec.unit == LengthUnit::millimetre ? 2
           : spec.unit == LengthUnit::micrometre ? 3
                                                 : 0;
}

template <class Real, class Integer>
void put_nifti(const VolumeFileSpec& spec, std::string& header, std::size_t dim, std::size_t pixdim,
               std::size_t quaternion, std::size_t rows) {
    put<Integer>(header, dim, 3);
    for (std::size_t i = 1; i < 8; ++i) {
        const std::int64_t n = i <= 3 ? spec.nodes[static_cast<int>(i) - 1] : 1;
        put(header, dim + i * sizeof(Integer), static_cast<Integer>(n));
    }
    for (std::size_t i = 0; i < 4; ++i) {
        put(header, pixdim + i * sizeof(Real),
            static_cast<Real>(i == 0 ? 1 : spec.spacing.at(i - 1)));
    }
    for (std::size_t w = 0; w < 3; ++w) {
        for (std::size_t a = 0; a < 3; ++a) {
            put(header, rows + (4 * w + a) * sizeof(Real), static_cast<Real>(step(spec, a).at(w)));
        }
        put(header, rows + (4 * w + 3) * sizeof(Real), static_cast<Real>(spec.origin.at(w)));
    }
    if (spec.frame == AnatomicalFrame::unknown) {
        return;
    }
    const std::array<double, 3> turned = nifti_quaternion(spec.direction);
    for (std::size_t i = 0; i < 3; ++i) {
        put(header, quaternion + i * sizeof(Real), static_cast<Real>(turned.at(i)));
        put(header, quaternion + (3 + i) * sizeof(Real), static_cast<Real>(spec.origin.at(i)));
    }
}

}  // namespace

VolumeHeader nrrd_file_header(const VolumeFileSpec& spec) {
    const std::string_view type = spec.is_int64                 ? "int64"
                                  : spec.type == ValueType::f32 ? "float"
                                  : spec.type == ValueType::f64 ? "double"
                                                                : name_of(spec.type);
    const std::string_view space =
        spec.frame == AnatomicalFrame::ras   ? "space: right-anterior-superior"
        : spec.frame == AnatomicalFrame::lps ? "space: left-posterior-superior"
                                             : "space dimension: 3";
    std::string directions;
    for (std::size_t a = 0; a < 3; ++a) {
        const Double3 v = step(spec, a);
        directions += fmt::format(" ({},{},{})", v[0], v[1], v[2]);
    }
    return {fmt::format(
        "NRRD0004\ntype: {}\ndimension: 3\n{}\nsizes: {} {} {}\n"
        "space directions:{}\nspace origin: ({},{},{})\n{}"
        "endian: little\nencoding: raw\n\n",
        type, space, spec.nodes.x, spec.nodes.y, spec.nodes.z, directions, spec.origin[0],
        spec.origin[1], spec.origin[2],
        spec.unit ? fmt::format("space units: \"{0}\" \"{0}\" \"{0}\"\n", symbol_of(*spec.unit))
                  : "")};
}

VolumeHeader nifti_file_header(const VolumeFileSpec& any) {
    const VolumeFileSpec spec = in_frame(any, AnatomicalFrame::ras);
    // Both forms say the place in a scanner. Where the frame is unknown the rows alone say a place,
    // as there is no other way to have origin and directions in a file.
    const std::int16_t qform = spec.frame == AnatomicalFrame::unknown ? 0 : 1;
    constexpr std::array<std::int16_t, 9> kTypes{2, 256, 512, 4, 768, 8, 16, 64, 1024};
    const std::int16_t type = word_of(spec, kTypes);
    const auto bits = static_cast<std::int16_t>(8 * size_of(spec.type));
    constexpr std::int64_t kMostShort = 32767;
    if (std::max({spec.nodes.x, spec.nodes.y, spec.nodes.z}) <= kMostShort) {
        std::string header(352, '\0');
        put<std::int32_t>(header, 0, 348);
        put_nifti<float, std::int16_t>(spec, header, 40, 76, 256, 280);
        put(header, 70, type);
        put(header, 72, bits);
        put<float>(header, 108, 352);
        put<float>(header, 112, 1);
        put<std::int16_t>(header, 252, qform);
        put<std::int16_t>(header, 254, 1);
        header[123] = nifti_unit(spec);
        std::memcpy(header.data() + 344, "n+1", 4);
        return {header};
    }
    std::string header(544, '\0');
    put<std::int32_t>(header, 0, 540);
    std::memcpy(header.data() + 4, "n+2\0\r\n\032\n", 8);
    put(header, 12, type);
    put(header, 14, bits);
    put_nifti<double, std::int64_t>(spec, header, 16, 104, 352, 400);
    put<std::int64_t>(header, 168, 544);
    put<double>(header, 176, 1);
    put<std::int32_t>(header, 344, qform);
    put<std::int32_t>(header, 348, 1);
    put<std::int32_t>(header, 500, nifti_unit(spec));
    return {header};
}

VolumeHeader vti_file_header(const VolumeFileSpec& spec) {
    constexpr std::array<std::string_view, 9> kTypes{
        "UInt8", "Int8", "UInt16", "Int16", "UInt32", "Int32", "Float32", "Float64", "Int64"};
    const std::string extent =
        fmt::format("0 {} 0 {} 0 {}", spec.nodes.x - 1, spec.nodes.y - 1, spec.nodes.z - 1);
    std::string text = fmt::format(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" "
        "byte_order=\"LittleEndian\" header_type=\"UInt64\">\n"
        "<ImageData WholeExtent=\"{}\" Origin=\"{} {} {}\" Spacing=\"{} {} {}\"{}>\n"
        "<Piece Extent=\"{}\">\n<PointData Scalars=\"data\">\n"
        "<DataArray type=\"{}\" Name=\"data\" format=\"appended\" offset=\"0\"/>\n"
        "</PointData>\n</Piece>\n</ImageData>\n<AppendedData encoding=\"raw\">\n_",
        extent, spec.origin[0], spec.origin[1], spec.origin[2], spec.spacing[0], spec.spacing[1],
        spec.spacing[2],
        spec.direction == kAlongWorld
            ? ""
            : fmt::format(" Direction=\"{}\"", fmt::join(vtk_direction(spec.direction), " ")),
        extent, word_of(spec, kTypes));
    const std::uint64_t bytes =
        static_cast<std::uint64_t>(spec.nodes.product()) * size_of(spec.type);
    text.append(reinterpret_cast<const char*>(&bytes), sizeof(bytes));
    return {text, "\n</AppendedData>\n</VTKFile>\n"};
}

VolumeHeader npy_file_header(const VolumeFileSpec& spec) {
    constexpr std::array<std::string_view, 9> kTypes{"|u1", "|i1", "<u2", "<i2", "<u4",
                                                     "<i4", "<f4", "<f8", "<i8"};
    std::string text =
        fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}, {}, {}), }}",
                    word_of(spec, kTypes), spec.nodes.z, spec.nodes.y, spec.nodes.x);
    constexpr std::size_t kBefore = 10;
    constexpr std::size_t kMultiple = 64;
    const std::size_t whole = (kBefore + text.size() + 1 + kMultiple - 1) / kMultiple * kMultiple;
    text.resize(whole - kBefore - 1, ' ');
    text += '\n';
    std::string header("\x93NUMPY\1\0", 8);
    header += static_cast<char>(text.size() % 256);
    header += static_cast<char>(text.size() / 256);
    return {header + text};
}

/// A line about a unit that MetaIO knows.
std::string meta_image_unit(const VolumeFileSpec& spec) {
    const bool known = spec.unit == LengthUnit::centimetre || spec.unit == LengthUnit::millimetre ||
                       spec.unit == LengthUnit::micrometre;
    return known ? fmt::format("DistanceUnits = {}\n", symbol_of(*spec.unit)) : "";
}

VolumeHeader meta_image_file_header(const VolumeFileSpec& any) {
    const VolumeFileSpec spec = in_frame(any, AnatomicalFrame::lps);
    constexpr std::array<std::string_view, 9> kTypes{"MET_UCHAR", "MET_CHAR",   "MET_USHORT",
                                                     "MET_SHORT", "MET_UINT",   "MET_INT",
                                                     "MET_FLOAT", "MET_DOUBLE", "MET_LONG_LONG"};
    std::string matrix;
    for (const Double3& axis : spec.direction) {
        matrix += fmt::format("{}{} {} {}", matrix.empty() ? "" : " ", axis[0], axis[1], axis[2]);
    }
    return {fmt::format(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
        "CompressedData = False\nTransformMatrix = {}\nOffset = {} {} {}\n"
        "CenterOfRotation = 0 0 0\nAnatomicalOrientation = {}\nElementSpacing = {} {} {}\nDimSize "
        "= {} {} {}\n"
        "ElementType = {}\n{}ElementDataFile = LOCAL\n",
        matrix, spec.origin[0], spec.origin[1], spec.origin[2], meta_image_orientation(spec),
        spec.spacing[0], spec.spacing[1], spec.spacing[2], spec.nodes.x, spec.nodes.y, spec.nodes.z,
        word_of(spec, kTypes), meta_image_unit(spec))};
}

}  // namespace isonest::detail
