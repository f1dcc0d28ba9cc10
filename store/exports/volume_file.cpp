#include "store/exports/volume_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>
#include <utility>

#include <isonest/error.h>

#include "store/base/vectors.h"
#include "store/container/parts/hdf5_types.h"
#include "store/container/parts/header_writer.h"
#include "store/exports/polydata_file.h"
#include "store/files/output_file.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {
namespace {

/// The entry for the type in a list in the order of ValueType, followed by int64.
template <class Word>
Word word_of(const VolumeFileSpec& spec, const std::array<Word, 9>& words) {
    return spec.is_int64 ? words.back() : words.at(static_cast<std::size_t>(spec.type));
}

template <class T>
void put(std::string& header, std::size_t at, T value) {
    std::memcpy(header.data() + at, &value, sizeof(value));
}

/// Converts the position to another frame, if both are known.
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
/// determined first, to avoid division by a small one.
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
    // Normalised, so that the reader's formula for the fourth is not the root of a negative number.
    const double length =
        std::sqrt(a * a + found[0] * found[0] + found[1] * found[1] + found[2] * found[2]);
    const double scale = (a < 0 ? -1 : 1) / length;
    return {found[0] * scale, found[1] * scale, found[2] * scale};
}

/// The direction of each axis in a patient, as the letter of the side where it starts, like ITK
/// writes it: each axis gets the nearest world axis that no earlier axis has taken.
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

/// The world vector from a node to the next one along an axis.
Double3 step(const VolumeFileSpec& spec, std::size_t axis) {
    Double3 v = spec.direction.at(axis);
    for (double& component : v) {
        component *= spec.spacing.at(axis);
    }
    return v;
}

/// NIfTI's number of the unit; 0 for units that it does not have.
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
    if (spec.frame == AnatomicalFrame::unknown || !are_directions(spec.direction)) {
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
    // Both forms give the position in a scanner. If the frame is unknown, only the rows (sform) are
    // written, because a file has no other way to store origin and directions. A quaternion cannot
    // represent a shear.
    const bool sheared = !are_directions(spec.direction);
    const std::int16_t qform = spec.frame == AnatomicalFrame::unknown || sheared ? 0 : 1;
    constexpr std::array<std::int16_t, 9> kTypes{2, 256, 512, 4, 768, 8, 16, 64, 1024};
    const std::int16_t type = word_of(spec, kTypes);
    const auto bits = static_cast<std::int16_t>(8 * size_of(spec.type));
    constexpr std::int64_t kMaxShort = 32767;
    if (std::max({spec.nodes.x, spec.nodes.y, spec.nodes.z}) <= kMaxShort) {
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

/// The numbers are part of the XML, which every version of VTK can read with every version of
/// expat; raw appended data are not valid XML.
VolumeHeader vti_file_header(const VolumeFileSpec& spec) {
    constexpr std::array<std::string_view, 9> kTypes{
        "UInt8", "Int8", "UInt16", "Int16", "UInt32", "Int32", "Float32", "Float64", "Int64"};
    const std::string extent =
        fmt::format("0 {} 0 {} 0 {}", spec.nodes.x - 1, spec.nodes.y - 1, spec.nodes.z - 1);
    const std::string text = fmt::format(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" "
        "byte_order=\"LittleEndian\" header_type=\"UInt64\">\n"
        "<ImageData WholeExtent=\"{}\" Origin=\"{} {} {}\" Spacing=\"{} {} {}\"{}>\n"
        "<Piece Extent=\"{}\">\n<PointData Scalars=\"data\">\n"
        "<DataArray type=\"{}\" Name=\"data\" format=\"binary\">\n",
        extent, spec.origin[0], spec.origin[1], spec.origin[2], spec.spacing[0], spec.spacing[1],
        spec.spacing[2],
        spec.direction == kAlongWorld
            ? ""
            : fmt::format(" Direction=\"{}\"", fmt::join(vtk_direction(spec.direction), " ")),
        extent, word_of(spec, kTypes));
    return {text, "\n</DataArray>\n</PointData>\n</Piece>\n</ImageData>\n</VTKFile>\n", true};
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

/// A line with the unit, if MetaIO knows it.
std::string meta_image_unit(const VolumeFileSpec& spec) {
    const bool known = spec.unit == LengthUnit::centimetre || spec.unit == LengthUnit::millimetre ||
                       spec.unit == LengthUnit::micrometre;
    return known ? fmt::format("DistanceUnits = {}\n", symbol_of(*spec.unit)) : "";
}

VolumeHeader meta_image_file_header(const VolumeFileSpec& any) {
    if (!are_directions(any.direction)) {
        throw Error(ErrorKind::unsupported,
                    "sheared axes: MetaImage files have axes at right angles; .nrrd, .nii, .vti "
                    "and .h5 take a shear");
    }
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

namespace {

class Hdf5File : public VolumeFile {
  public:
    Hdf5File(std::filesystem::path path, const VolumeFileSpec& spec)
        : path_(std::move(path)), unfinished_(path_, spec.force), spec_(spec) {
        const QuietHdf5 quiet;
        file_ = create_hdf5(unfinished_.name());
        const std::array<hsize_t, 3> dims = shape(spec_.nodes);
        const SpaceHandle space(H5Screate_simple(3, dims.data(), nullptr));
        const PropertyHandle creation(H5Pcreate(H5P_DATASET_CREATE));
        H5Pset_obj_track_times(creation.get(), false);
        H5Pset_fill_time(creation.get(), H5D_FILL_TIME_NEVER);
        const TypeHandle type = numbers_type();
        if (file_.valid()) {
            unfinished_.created();
            data_ = DatasetHandle(H5Dcreate2(file_.get(), "data", type.get(), space.get(),
                                             H5P_DEFAULT, creation.get(), H5P_DEFAULT));
        }
        if (!data_.valid()) {
            fail("create it");
        }
        write_attribute(data_.get(), "spacing",
                        std::vector<double>(spec_.spacing.begin(), spec_.spacing.end()));
        write_attribute(data_.get(), "origin",
                        std::vector<double>(spec_.origin.begin(), spec_.origin.end()));
        if (spec_.direction != kAlongWorld) {
            write_attribute(data_.get(), "direction", vtk_direction(spec_.direction));
        }
        if (spec_.unit) {
            write_attribute(data_.get(), "unit", std::string(symbol_of(*spec_.unit)));
        }
        if (spec_.frame != AnatomicalFrame::unknown) {
            write_attribute(data_.get(), "frame", std::string(name_of(spec_.frame)));
        }
    }
    ~Hdf5File() override {
        const QuietHdf5 quiet;
        data_.reset();
        file_.reset();
    }
    void write(const std::byte* planes, std::int64_t count) override {
        write_box({0, 0, next_}, {spec_.nodes.x, spec_.nodes.y, count}, planes);
        next_ += count;
    }
    void write_box(const Int3& lo, const Int3& size, const std::byte* data) override {
        const QuietHdf5 quiet;
        const std::array<hsize_t, 3> start = shape(lo);
        const std::array<hsize_t, 3> count = shape(size);
        const SpaceHandle to(H5Dget_space(data_.get()));
        H5Sselect_hyperslab(to.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr);
        const SpaceHandle from(H5Screate_simple(3, count.data(), nullptr));
        const TypeHandle type = numbers_type();
        if (H5Dwrite(data_.get(), type.get(), from.get(), to.get(), H5P_DEFAULT, data) < 0) {
            fail("write it");
        }
    }
    void finish() override {
        const QuietHdf5 quiet;
        const bool closed = data_.close();
        if (!file_.close() || !closed) {
            fail("close it");
        }
        unfinished_.publish();
    }

  private:
    [[nodiscard]] TypeHandle numbers_type() const {
        return spec_.is_int64 ? TypeHandle(H5Tcopy(H5T_STD_I64LE)) : file_type(spec_.type);
    }
    [[nodiscard]] static std::array<hsize_t, 3> shape(const Int3& n) {
        return {static_cast<hsize_t>(n.z), static_cast<hsize_t>(n.y), static_cast<hsize_t>(n.x)};
    }
    [[noreturn]] void fail(const char* what) {
        const std::string detail = hdf5_message();
        data_.reset();
        file_.reset();
        throw Error(ErrorKind::io, {path_.string()}, fmt::format("cannot {}: {}", what, detail));
    }
    std::filesystem::path path_;
    UnfinishedFile unfinished_;
    VolumeFileSpec spec_;
    FileHandle file_;
    DatasetHandle data_;
    std::int64_t next_ = 0;
};

class FlatFile : public VolumeFile {
  public:
    FlatFile(const std::filesystem::path& path, const VolumeFileSpec& spec,
             const VolumeHeader& header)
        : file_(path, spec.force), spec_(spec), header_bytes_(header.before.size()) {
        file_.write_at(0, std::as_bytes(std::span(header.before)));
        const auto numbers = static_cast<std::uint64_t>(spec.nodes.product()) * size_of(spec.type);
        std::uint64_t stored = numbers;
        if (header.in_base64) {
            text_ = {header_bytes_, kLength + numbers};
            stored = text_.letters();
            put(0, std::as_bytes(std::span(&numbers, 1)));
        }
        if (!header.behind.empty()) {
            file_.write_at(header_bytes_ + stored, std::as_bytes(std::span(header.behind)));
        }
    }
    void write(const std::byte* planes, std::int64_t count) override {
        write_box({0, 0, next_}, {spec_.nodes.x, spec_.nodes.y, count}, planes);
        next_ += count;
    }
    void write_box(const Int3& lo, const Int3& size, const std::byte* data) override {
        const Int3& n = spec_.nodes;
        const std::size_t element = size_of(spec_.type);
        const bool whole_rows = size.x == n.x;
        const bool whole_planes = whole_rows && size.y == n.y;
        // Contiguous parts of the file are written at once.
        const Int3 step{size.x, whole_rows ? size.y : 1, whole_planes ? size.z : 1};
        const std::size_t bytes = static_cast<std::size_t>(step.product()) * element;
        for (std::int64_t z = 0; z < size.z; z += step.z) {
            for (std::int64_t y = 0; y < size.y; y += step.y) {
                const auto first = static_cast<std::uint64_t>(n.linear(lo + Int3{0, y, z}));
                if (text_.bytes > 0) {
                    put(kLength + first * element, {data, bytes});
                } else {
                    file_.write_at(header_bytes_ + first * element, {data, bytes});
                }
                data += bytes;
            }
        }
    }
    void finish() override { file_.publish_as_named(); }
    [[nodiscard]] std::uint64_t held(std::uint64_t rows) const override {
        constexpr std::uint64_t kEnds = 2;  // the ends of a row, which wait for the neighbouring
                                            // rows
        return text_.bytes > 0 ? Base64Rows::kLetters + kEnds * rows * Base64Rows::kWaiting : 0;
    }

  private:
    static constexpr std::uint64_t kLength = sizeof(std::uint64_t);

    void put(std::uint64_t at, std::span<const std::byte> bytes) {
        base64_.put(text_, at, bytes,
                    [this](std::uint64_t place, std::span<const std::byte> letters) {
                        file_.write_at(place, letters);
                    });
    }

    OutputFile file_;
    VolumeFileSpec spec_;
    std::uint64_t header_bytes_;
    Base64Array text_;  ///< the length and the numbers, if they are in base64
    Base64Rows base64_;
    std::int64_t next_ = 0;
};

}  // namespace

std::unique_ptr<VolumeFile> create_volume_file(const std::filesystem::path& path,
                                               const VolumeFileSpec& spec) {
    const std::string ending = path.extension().string();
    if ((spec.uneven || spec.is_curved) && ending != ".npy" && ending != ".raw") {
        throw Error(ErrorKind::unsupported, {path.string()},
                    spec.is_curved
                        ? "this format cannot store the positions of a curvilinear grid"
                        : "the nodes of the volume lie at uneven distances, which this format "
                          "cannot store",
                    {{RemedyKind::other_format, ".npy, .raw"}});
    }
    if (ending == ".h5" || ending == ".hdf5") {
        return std::make_unique<Hdf5File>(path, spec);
    }
    using MakeHeader = VolumeHeader (*)(const VolumeFileSpec&);
    constexpr std::array<std::pair<std::string_view, MakeHeader>, 6> kFlat{
        {{".nrrd", nrrd_file_header},
         {".nii", nifti_file_header},
         {".vti", vti_file_header},
         {".npy", npy_file_header},
         {".mha", meta_image_file_header},
         {".raw", [](const VolumeFileSpec&) { return VolumeHeader{}; }}}};
    for (const auto& [name, make_header] : kFlat) {
        if (ending == name) {
            return std::make_unique<FlatFile>(path, spec, make_header(spec));
        }
    }
    throw Error(ErrorKind::invalid_argument, {path.string()},
                "unknown ending: give .h5, .nrrd, .nii, .vti, .npy, .mha or .raw");
}

}  // namespace isonest::detail
