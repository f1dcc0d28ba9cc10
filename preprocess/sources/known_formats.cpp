#include "preprocess/sources/known_formats.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string_view>
#include <system_error>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {
namespace {

using namespace std::string_view_literals;

/// In advice, FILE stands for the file's name and STEM for the name without its extension.
struct Signature {
    std::size_t at;
    std::string_view bytes;
    const char* what;
    const char* advice;
};

constexpr const char* kBioFormats =
    "convert it with Bio-Formats: bfconvert 'FILE' 'STEM.ome.tif' (or save it as TIFF in Fiji)";
constexpr const char* kPictures =
    "if it is a slice of a volume, combine the slices into one file: convert '*.EXT' -colorspace "
    "Gray 'STEM.tif' (ImageMagick)";
constexpr const char* kResample =
    "in ParaView apply 'Resample To Image' and save the result as .vti";
constexpr const char* kMesh =
    "a surface has no values to preprocess: give the volume from which it was made";

constexpr std::array kSignatures{
    // Microscopes and other instruments.
    Signature{0, "ZISRAWFILE", "a Zeiss CZI file", kBioFormats},
    Signature{0, "\x70\0\0\0"sv, "a Leica LIF file", kBioFormats},
    Signature{0, "\xDA\xCE\xBE\x0A", "a Nikon ND2 file", kBioFormats},
    Signature{0, "\xD0\xCF\x11\xE0\xA1\xB1\x1A\xE1",
              "an OLE file (Olympus OIB, Zeiss ZVI or Xradia TXM)", kBioFormats},
    Signature{0, "\xFF\xFE[\0F\0i\0l\0e\0I\0n\0f\0o\0"sv, "an Olympus OIF file", kBioFormats},
    Signature{0, "II\x97\x01", "a TIA SER file",
              "convert it: e2proc3d.py 'FILE' 'STEM.mrc' (EMAN2)"},
    Signature{0, "raw_image_stack_by_hpeng", "a Vaa3D stack", kBioFormats},
    // Pictures.
    Signature{0, "\xFF\xD8\xFF", "a JPEG image", kPictures},
    Signature{0, "\0\0\0\x0CjP  \r\n\x87\n"sv, "a JPEG 2000 image", kPictures},
    Signature{0, "\xFF\x4F\xFF\x51", "a JPEG 2000 codestream", kPictures},
    Signature{0, "\xFF\x0A", "a JPEG XL image", kPictures},
    Signature{0, "\0\0\0\x0CJXL \r\n\x87\n"sv, "a JPEG XL image", kPictures},
    Signature{0, "GIF87a", "a GIF image", kPictures},
    Signature{0, "GIF89a", "a GIF image", kPictures},
    Signature{8, "WEBPVP8", "a WebP image", kPictures},
    Signature{0, "\x76\x2F\x31\x01", "an OpenEXR image", kPictures},
    Signature{0, "8BPS\0\1"sv, "a Photoshop image", kPictures},
    Signature{0, "%PDF-", "a PDF document", "give the volume that it shows"},
    // Medicine.
    Signature{0, "mrtrix image\n", "an MRtrix image", "convert it: mrconvert 'FILE' 'STEM.nii.gz'"},
    Signature{0, "MATRIX7", "an ECAT file", "convert it: medcon -f 'FILE' -c nifti"},
    Signature{0, "# === DATA DESCRIPTION FILE ===", "a Philips PAR header",
              "convert it with its .REC file: parrec2nii 'FILE' (nibabel)"},
    Signature{0, "\xFF\xFF\xFE", "a FreeSurfer surface mesh", kMesh},
    // Simulations, astronomy, weather.
    Signature{0, "SIMPLE  =", "a FITS file",
              "convert it: python3 -c \"import numpy; from astropy.io import fits; "
              "numpy.save('STEM.npy', fits.getdata('FILE'))\""},
    Signature{0, "GRIB", "a GRIB file", "convert it: cdo -f nc copy 'FILE' 'STEM.nc'"},
    Signature{0, "\x0E\x03\x13\x01", "an HDF4 file", "convert it: h4toh5 'FILE' 'STEM.h5'"},
    Signature{0, "root\0"sv, "a ROOT file",
              "read its histogram with uproot in Python and save it with numpy.save()"},
    Signature{0, "MATLAB 5.0 MAT-file", "a MATLAB file older than version 7.3",
              "in MATLAB save it with '-v7.3', or convert it: python3 -c \"import numpy, scipy.io; "
              "numpy.save('STEM.npy', scipy.io.loadmat('FILE')['NAME'])\""},
    Signature{0, "#!TDV", "a Tecplot file", kResample},
    Signature{0, "FoamFile", "an OpenFOAM file", kResample},
    Signature{0, "C Binary", "an EnSight file", kResample},
    Signature{0, "NanoVDB", "a NanoVDB file", "convert it: nanovdb_convert 'FILE' 'STEM.vdb'"},
    Signature{0, "PVM\n", "a PVM volume", "convert it: pvm2raw 'FILE' 'STEM.raw'"},
    Signature{0, "PVM2\n", "a PVM volume", "convert it: pvm2raw 'FILE' 'STEM.raw'"},
    Signature{0, "PVM3\n", "a PVM volume", "convert it: pvm2raw 'FILE' 'STEM.raw'"},
    Signature{0, "DDS v3d\n", "a packed PVM volume", "convert it: pvm2raw 'FILE' 'STEM.raw'"},
    Signature{0, "DDS v3e\n", "a packed PVM volume", "convert it: pvm2raw 'FILE' 'STEM.raw'"},
    Signature{0, "# AmiraMesh", "an Amira file", "save it as NRRD or TIFF in Amira, Avizo or Fiji"},
    Signature{0, "# Avizo", "an Avizo file", "save it as NRRD or TIFF in Amira, Avizo or Fiji"},
    Signature{0, "# HyperSurface", "an Amira surface mesh", kMesh},
    // Meshes.
    Signature{0, "ply\n", "a PLY mesh", kMesh},
    Signature{0, "ply\r\n", "a PLY mesh", kMesh},
    Signature{0, "OFF\n", "an OFF mesh", kMesh},
    Signature{0, "glTF", "a glTF mesh", kMesh},
    // Archives and compressed files.
    Signature{0, "PK\3\4", "a ZIP archive without a NumPy or Zarr array",
              "unpack it (unzip 'FILE') and give the volume in it"},
    Signature{0, "PK\5\6", "an empty ZIP archive", "give another file"},
    Signature{0, "7z\xBC\xAF\x27\x1C", "a 7z archive",
              "unpack it (7z x 'FILE') and give the volume in it"},
    Signature{0, "Rar!\x1A\x07", "a RAR archive",
              "unpack it (unrar x 'FILE') and give the volume in it"},
    Signature{257, "ustar", "a tar archive", "unpack it (tar xf 'FILE') and give the volume in it"},
    Signature{0, "BZh", "a bzip2 file", "unpack it first: bunzip2 -k 'FILE'"},
    Signature{0, "\xFD\x37zXZ\0"sv, "an xz file", "unpack it first: unxz -k 'FILE'"},
    Signature{0, "\x28\xB5\x2F\xFD", "a zstd file", "unpack it first: unzstd 'FILE'"},
    Signature{0, "\x04\x22\x4D\x18", "an LZ4 file", "unpack it first: unlz4 'FILE'"},
    Signature{0, "\x1F\x9D", "a compress (.Z) file", "unpack it first: uncompress -k 'FILE'"},
    Signature{0, "version https://git-lfs.github.com/spec/",
              "a Git LFS pointer, not the file itself", "fetch the file itself: git lfs pull"},
};

std::string replaced(std::string text, std::string_view what, const std::string& with) {
    for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += with.size()) {
        text.replace(at, what.size(), with);
    }
    return text;
}

/// A quote in a name would break out of the quoted argument of the command.
std::string shown_name(const std::filesystem::path& name) {
    const std::string text = name.string();
    return text.empty() || text.find('\'') != std::string::npos ? "FILE" : text;
}

KnownFormat about(const std::filesystem::path& path, const char* what, const char* advice) {
    std::filesystem::path stem = path.filename();
    if (stem.extension() == ".gz") {
        stem.replace_extension();
    }
    const std::string ending = stem.extension().string();
    stem.replace_extension();
    const std::string file = shown_name(path.filename());
    std::string text = advice;
    if (ending.size() > 1) {
        text = replaced(text, "EXT", shown_name(ending.substr(1)));
    } else {
        text = replaced(text, "*.EXT", "*");
    }
    text = replaced(text, "STEM", file == "FILE" ? "STEM" : shown_name(stem));
    return {what, file == "FILE" ? text : replaced(text, "FILE", file)};
}

bool has_signature(const Signature& signature, std::string_view head) {
    if (head.size() < signature.at + signature.bytes.size() ||
        head.substr(signature.at, signature.bytes.size()) != signature.bytes) {
        return false;
    }
    // Short signatures are confirmed by further bytes.
    if (signature.bytes == "BZh") {
        return head.size() >= 10 && head[3] >= '1' && head[3] <= '9' &&
               (head.substr(4, 6) == "1AY&SY" || head.substr(4, 6) == "\x17\x72\x45\x38\x50\x90");
    }
    if (signature.bytes == "\x70\0\0\0"sv) {
        return head.size() > 16 && head[8] == '*' && head[14] == '\0' && head[13] == '<';
    }
    if (signature.bytes == "WEBPVP8") {
        return head.starts_with("RIFF");
    }
    if (signature.bytes == "GRIB") {
        return head.size() > 8 && (head[7] == 1 || head[7] == 2);
    }
    if (signature.bytes == "\xFF\xFF\xFE") {
        return head.substr(3).starts_with("created by ");
    }
    if (signature.bytes == "\x1F\x9D"sv || signature.bytes == "\xFF\x0A"sv) {
        return false;  // only two bytes: with_ending() also requires the name
    }
    return true;
}

/// Signatures of two bytes are only accepted if the file name extension agrees.
const Signature* with_ending(const VolumeInput& input) {
    const std::string ending = lower(input.path().extension().string());
    for (const auto& [bytes, of] :
         {std::pair{"\x1F\x9D"sv, ".z"sv}, std::pair{"\xFF\x0A"sv, ".jxl"sv}}) {
        if (ending == of && input.head.starts_with(bytes)) {
            return &*std::find_if(kSignatures.begin(), kSignatures.end(),
                                  [start = bytes](const Signature& s) { return s.bytes == start; });
        }
    }
    return nullptr;
}

// Text headers.

/// At most `most` bytes of text, in lower case, without a byte order mark and leading blanks.
std::string text_of(std::string_view head) {
    if (head.starts_with("\xEF\xBB\xBF")) {
        head.remove_prefix(3);
    }
    const std::size_t begin = head.find_first_not_of(" \t\r\n");
    head.remove_prefix(begin == std::string_view::npos ? head.size() : begin);
    const bool is_text = std::none_of(head.begin(), head.end(), [](char c) {
        const auto byte = static_cast<unsigned char>(c);
        return byte < 9 || (byte > 13 && byte < 32);
    });
    return is_text ? lower(head) : "";
}

bool is_afni_header(std::string_view text) {
    constexpr std::size_t kSoon = 200;
    const std::string_view start = text.substr(0, kSoon);
    return start.starts_with("type") && start.find("-attribute") != std::string_view::npos &&
           start.find("name") != std::string_view::npos;
}

/// Lines like `v 1 2 3`, after comment lines.
bool is_obj(std::string_view text) {
    while (!text.empty()) {
        const std::size_t end = text.find('\n');
        const std::string_view line = text.substr(0, end);
        if (line.starts_with("v ")) {
            constexpr std::string_view kNumber = "0123456789+-.e \t\r";
            return line.size() > 6 && line.find_first_not_of(kNumber, 2) == std::string_view::npos;
        }
        const bool is_blank = line.find_first_not_of(" \t\r") == std::string_view::npos;
        if (!is_blank && !line.starts_with('#') && !line.starts_with("mtllib") &&
            !line.starts_with("o ") && !line.starts_with("g ")) {
            return false;
        }
        text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    }
    return false;
}

/// VTK XML of types other than ImageData, and other XML.
std::optional<KnownFormat> known_xml(const std::filesystem::path& path, std::string_view text) {
    struct Kind {
        std::string_view word;
        const char* what;
        const char* advice;
    };
    if (text.find("<vtkfile") != std::string_view::npos) {
        constexpr const char* kPieces =
            "open it in ParaView and save it as one .vti, or give one of the files that it lists";
        constexpr std::array kKinds{
            Kind{"\"unstructuredgrid\"", "a VTK unstructured grid (.vtu)", kResample},
            Kind{"\"hypertreegrid\"", "a VTK hyper tree grid (.htg)", kResample},
            Kind{"\"polydata\"", "a VTK mesh (.vtp)", kMesh},
            Kind{"\"pimagedata\"", "a list of the pieces of a VTK image (.pvti)", kPieces},
            Kind{"\"prectilineargrid\"", "a list of the pieces of a VTK rectilinear grid (.pvtr)",
                 kResample},
            Kind{"\"pstructuredgrid\"", "a list of the pieces of a VTK curvilinear grid (.pvts)",
                 kResample},
            Kind{"\"punstructuredgrid\"", "a list of the pieces of a VTK unstructured grid (.pvtu)",
                 kResample},
            Kind{"\"ppolydata\"", "a list of the pieces of a VTK mesh (.pvtp)", kMesh},
            Kind{"\"vtkmultiblockdataset\"", "a list of VTK data sets (.vtm)", kPieces},
            Kind{"\"vtkpartitioneddataset", "a list of VTK data sets (.vtpc)", kPieces},
            Kind{"\"vtkoverlappingamr\"", "a VTK grid with adaptive refinement (.vth)", kResample},
            Kind{"\"collection\"", "a ParaView list of time steps (.pvd)",
                 "give the file of one step"}};
        std::string quoted(text);
        std::replace(quoted.begin(), quoted.end(), '\'', '"');
        for (const Kind& kind : kKinds) {
            if (quoted.find(std::string("type=").append(kind.word)) != std::string::npos) {
                return about(path, kind.what, kind.advice);
            }
        }
        return std::nullopt;
    }
    constexpr std::array kKinds{
        Kind{"<spimdata", "a BigDataViewer XML file",
             "give the .h5 file beside it, and choose a dataset such as t00000/s00/0/cells"},
        Kind{"<xdmf", "an XDMF file",
             "give the HDF5 file that it describes, and choose its dataset"},
        Kind{"<gifti", "a GIFTI mesh", kMesh},
        Kind{"<x3d", "an X3D mesh", kMesh},
        Kind{"<svg", "an SVG image", "give the volume that it shows"},
        Kind{"<!doctype html", "a web page, perhaps instead of the file",
             "open it in a browser and download the file itself"},
        Kind{"<html", "a web page, perhaps instead of the file",
             "open it in a browser and download the file itself"},
        Kind{"<error>", "an error message from a server",
             "read it (cat 'FILE') and download again"}};
    for (const Kind& kind : kKinds) {
        if (text.find(kind.word) != std::string_view::npos) {
            return about(path, kind.what, kind.advice);
        }
    }
    return std::nullopt;
}

std::optional<KnownFormat> known_text(const VolumeInput& input) {
    const std::string text = text_of(input.unpacked);
    const std::filesystem::path& path = input.path();
    const auto has = [&](std::string_view word) { return text.find(word) != std::string::npos; };
    if (text.empty()) {
        return std::nullopt;
    }
    if (text.starts_with('<')) {
        return known_xml(path, text);
    }
    if (is_afni_header(text)) {
        return about(path, "an AFNI header", "convert it: 3dAFNItoNIFTI 'FILE'");
    }
    if (text.starts_with("!interfile")) {
        return about(path, "an Interfile header", "convert it: medcon -f 'FILE' -c nifti");
    }
    if (text.starts_with('{') && has("byteorder") && has("dim_1")) {
        return about(path, "an ESRF data file (EDF)",
                     "convert it: python3 -c \"import fabio, numpy; numpy.save('STEM.npy', "
                     "fabio.open('FILE').data)\"");
    }
    if (has("data_file:") && has("data_size:")) {
        return about(path, "a BOV header",
                     "its data file holds raw numbers: give that file, with the sizes of DATA_SIZE "
                     "and the type of DATA_FORMAT");
    }
    if (text.starts_with("{volume") || (text.starts_with("[volume") && has("file"))) {
        return about(path, "a VGStudio header (.vgi)",
                     "the .vol beside it holds raw numbers: give that file, with the size and the "
                     "type in the header");
    }
    if (has("ics_version") && text.find("ics_version") < 20) {
        return about(path, "an ICS file", kBioFormats);
    }
    if (text.starts_with("solid") && has("facet")) {
        return about(path, "an STL mesh", kMesh);
    }
    if (is_obj(text)) {
        return about(path, "an OBJ mesh", kMesh);
    }
    if (text.starts_with("format") && has("type:") && has("ensight")) {
        return about(path, "an EnSight case", kResample);
    }
    return std::nullopt;
}

// Headers that are recognised by numbers that must be consistent.

bool is_analyze(std::string_view head) {
    constexpr std::int32_t kBytes = 348;
    for (const bool big : {false, true}) {
        if (head.size() >= kBytes && number_at<std::int32_t>(head, 0, big) == kBytes) {
            const auto axes = number_at<std::int16_t>(head, 40, big);
            return axes >= 1 && axes <= 7 && number_at<std::int16_t>(head, 42, big) >= 1;
        }
    }
    return false;
}

/// Gatan files, versions 3 and 4: version, length of the rest, byte order.
bool is_digital_micrograph(std::string_view head, std::uint64_t size) {
    if (head.size() < 24) {
        return false;
    }
    const auto version = number_at<std::int32_t>(head, 0, true);
    if (version == 3) {
        const auto length = number_at<std::uint32_t>(head, 4, true);
        return number_at<std::uint32_t>(head, 8, true) <= 1 && length <= size &&
               size - length <= 64;
    }
    if (version == 4) {
        const auto length = number_at<std::uint64_t>(head, 4, true);
        return number_at<std::uint32_t>(head, 12, true) <= 1 && length <= size &&
               size - length <= 64;
    }
    return false;
}

/// "P5", white space, a number or a comment.
bool is_portable_bitmap(std::string_view head) {
    constexpr std::string_view kKinds = "123456";
    constexpr std::string_view kNext = "0123456789#";
    return head.size() > 3 && head[0] == 'P' && kKinds.find(head[1]) != std::string_view::npos &&
           (head[2] == '\n' || head[2] == ' ') && kNext.find(head[3]) != std::string_view::npos;
}

/// Source: https://spider.wadsworth.org/spider_doc/spider/docs/image_doc.html
bool is_spider(std::string_view head, std::uint64_t size) {
    constexpr std::size_t kWords = 24;
    if (head.size() < 4 * kWords) {
        return false;
    }
    for (const bool big : {false, true}) {
        const auto word = [&](std::size_t i) {
            return static_cast<double>(number_at<float>(head, 4 * (i - 1), big));
        };
        const auto is_count = [&](std::size_t i) {
            return word(i) >= 1 && word(i) <= 1e6 && word(i) == std::floor(word(i));
        };
        const bool is_kind = word(5) == 1 || word(5) == 3;
        if (is_kind && is_count(1) && is_count(2) && is_count(12) && is_count(13) && is_count(22) &&
            is_count(23) && word(22) == word(13) * word(23) && word(23) == 4 * word(12)) {
            const double bytes = word(22) + 4 * word(1) * word(2) * word(12);
            return bytes <= static_cast<double>(size);
        }
    }
    return false;
}

/// Grids and the data on them, with or without Fortran records; without records, the file size must
/// match the sizes in the header.
bool is_plot3d(std::string_view head, std::uint64_t size) {
    constexpr std::int64_t kMax = std::int64_t{1} << 20U;
    for (const bool big : {false, true}) {
        const auto word = [&](std::size_t i) {
            return std::int64_t{number_at<std::int32_t>(head, 4 * i, big)};
        };
        const auto are_sizes = [&](std::size_t from) {
            return word(from) >= 2 && word(from) <= kMax && word(from + 1) >= 2 &&
                   word(from + 1) <= kMax && word(from + 2) >= 1 && word(from + 2) <= kMax;
        };
        if (head.size() < 64) {
            return false;
        }
        if (word(0) == 12 && word(4) == 12 && are_sizes(1) && size > 20) {
            return true;
        }
        if (word(0) == 4 && word(2) == 4 && word(1) >= 1 && word(1) <= kMax &&
            word(3) == 12 * word(1) && are_sizes(4)) {
            return true;
        }
        if (are_sizes(0)) {
            const auto points =
                static_cast<double>(word(0) * word(1)) * static_cast<double>(word(2));
            for (const double bytes :
                 {12 + 12 * points, 12 + 16 * points, 12 + 24 * points, 12 + 28 * points,
                  12 + 16 + 20 * points, 12 + 32 + 40 * points}) {
                if (bytes == static_cast<double>(size)) {
                    return true;
                }
            }
        }
    }
    return false;
}

/// Source: https://bitbucket.org/fernandoamat/keller-lab-block-filetype
bool is_klb(std::string_view head) {
    constexpr std::size_t kHeader = 319;
    if (head.size() < kHeader || head[0] != 2) {
        return false;
    }
    const auto is_axis = [&](std::size_t i) {
        const auto length = number_at<std::uint32_t>(head, 1 + 4 * i, false);
        const auto block = number_at<std::uint32_t>(head, 299 + 4 * i, false);
        return length >= 1 && length <= (1U << 20U) && block >= 1 && block <= length;
    };
    return static_cast<unsigned char>(head[41]) <= 9 && static_cast<unsigned char>(head[42]) <= 2 &&
           is_axis(0) && is_axis(1) && is_axis(2) && is_axis(3) && is_axis(4);
}

bool is_binary_stl(std::string_view head, std::uint64_t size) {
    constexpr std::uint64_t kHeader = 84;
    constexpr std::uint64_t kTriangle = 50;
    return head.size() > kHeader && size > kHeader &&
           kHeader + kTriangle * number_at<std::uint32_t>(head, 80, false) == size;
}

std::optional<KnownFormat> known_numbers(const VolumeInput& input) {
    const std::string_view head = input.unpacked;
    const std::filesystem::path& path = input.path();
    constexpr const char* kAnalyze =
        "the format does not say which side is left; convert it: fslchfiletype NIFTI_GZ 'FILE' "
        "'STEM' (FSL)";
    if (is_analyze(head)) {
        return about(path, "an Analyze 7.5 header", kAnalyze);
    }
    if (is_portable_bitmap(head)) {
        return about(path, "a portable bitmap (PBM, PGM or PPM)", kPictures);
    }
    if (input.gzip()) {
        return std::nullopt;  // the checks below compare with the file's size
    }
    std::uint64_t size = 0;
    try {
        size = regular_file_size(input.file);
    } catch (const Error&) {
        return std::nullopt;
    }
    if (is_digital_micrograph(head, size)) {
        return about(path, "a DigitalMicrograph file (DM3 or DM4)",
                     "convert it: dm2mrc 'FILE' 'STEM.mrc' (IMOD)");
    }
    if (is_binary_stl(head, size)) {
        return about(path, "an STL mesh", kMesh);
    }
    if (is_klb(head)) {
        return about(path, "a KLB file", "save it as TIFF in Fiji, with the KLB plugin");
    }
    if (is_spider(head, size)) {
        return about(path, "a SPIDER file", "convert it: e2proc3d.py 'FILE' 'STEM.mrc' (EMAN2)");
    }
    if (is_plot3d(head, size)) {
        return about(path, "a PLOT3D file", kResample);
    }
    return std::nullopt;
}

/// For a file without its own header: what the header beside it is.
std::optional<KnownFormat> known_beside(const VolumeInput& input) {
    if (input.remote) {
        return std::nullopt;
    }
    std::filesystem::path path = input.path();
    if (path.extension() == ".gz") {
        path.replace_extension();
    }
    const auto head_with = [&](const char* ending) {
        std::filesystem::path header = path;
        header.replace_extension(ending);
        std::error_code error;
        if (!std::filesystem::is_regular_file(header, error)) {
            return std::string();
        }
        try {
            return first_bytes(header, VolumeInput::kHeadBytes);
        } catch (const Error&) {
            return std::string();
        }
    };
    if (path.extension() == ".BRIK" && is_afni_header(text_of(head_with(".HEAD")))) {
        path.replace_extension(".HEAD");
        return about(path, "an AFNI dataset", "convert it: 3dAFNItoNIFTI 'FILE'");
    }
    if (path.extension() == ".img" && is_analyze(head_with(".hdr"))) {
        return about(path, "an Analyze 7.5 image",
                     "the format does not say which side is left; convert it: fslchfiletype "
                     "NIFTI_GZ 'FILE' 'STEM' (FSL)");
    }
    return std::nullopt;
}

}  // namespace

std::optional<KnownFormat> known_format(const VolumeInput& input) {
    if (input.folder) {
        return std::nullopt;
    }
    for (const Signature& signature : kSignatures) {
        if (has_signature(signature, input.unpacked)) {
            return about(input.path(), signature.what, signature.advice);
        }
    }
    if (const Signature* const signature = with_ending(input)) {
        return about(input.path(), signature->what, signature->advice);
    }
    if (auto known = known_text(input)) {
        return known;
    }
    if (auto known = known_beside(input)) {
        return known;
    }
    return known_numbers(input);
}

std::optional<KnownFormat> known_folder(const std::filesystem::path& folder) {
    const auto has = [&](const char* name) {
        std::error_code error;
        return std::filesystem::exists(folder / name, error);
    };
    std::filesystem::path named = folder;
    if (!named.has_filename()) {
        named = named.parent_path();
    }
    const auto json = [&](const char* name) -> nlohmann::json {
        try {
            return read_json(folder / name).value_or(nlohmann::json());
        } catch (const Error&) {
            return {};
        }
    };
    if (has("info")) {
        const nlohmann::json info = json("info");
        if (info.is_object() && info.contains("scales") && info.contains("data_type")) {
            return about(named, "a Neuroglancer precomputed volume",
                         "convert it: python3 -c \"import cloudvolume, numpy; numpy.save('STEM.npy'"
                         ", cloudvolume.CloudVolume('file://FILE')[..., 0].T)\"");
        }
    }
    if (has("attributes.json")) {
        return about(named, "an N5 folder",
                     "convert it: python3 -c \"import zarr; zarr.save_array('STEM.zarr', "
                     "zarr.open(zarr.N5Store('FILE'), mode='r')['DATASET'][:])\"");
    }
    if (has("2dseq") && has("visu_pars")) {
        return about(named, "a Bruker ParaVision reconstruction",
                     "convert the study folder: brkraw tonii FOLDER");
    }
    if (has("acqp") && has("method")) {
        return about(named, "a Bruker ParaVision scan",
                     "convert the study folder: brkraw tonii FOLDER");
    }
    if (has("md.idx") && has("data.0")) {
        return about(named, "an ADIOS2 BP folder",
                     "read its variable with adios2 in Python and save it with numpy.save()");
    }
    return std::nullopt;
}

}  // namespace isonest::detail
