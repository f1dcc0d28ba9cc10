#include "preprocess/sources/dicom/dicom_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/dicom/dicom_elements.h"
#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

constexpr DicomTag kSharedGroups = 0x52009229;
constexpr DicomTag kFrameGroups = 0x52009230;
constexpr DicomTag kDetectors = 0x00540022;
constexpr DicomTag kFrameContent = 0x00209111;
constexpr DicomTag kPlanePosition = 0x00209113;
constexpr DicomTag kPlaneOrientation = 0x00209116;
constexpr DicomTag kPixelMeasures = 0x00289110;
constexpr DicomTag kValueTransformation = 0x00289145;
constexpr DicomTag kEcho = 0x00189114;
constexpr DicomTag kDiffusion = 0x00189117;
constexpr DicomTag kModalityTable = 0x00283000;
constexpr std::size_t kMaxTable = 65536;
constexpr DicomTag kSegments = 0x00620002;
constexpr DicomTag kSegmentOfFrame = 0x0062000A;
constexpr std::size_t kMaxSegments = 65535;
constexpr std::int64_t kMaxFrames = 1000000;
constexpr std::uint64_t kMaxCsa = 1U << 20U;

class HeaderVisitor {
  public:
    HeaderVisitor(DicomFile& file, DicomHeader& header, std::uint64_t max_bytes)
        : file_(file), header_(header), max_bytes_(max_bytes) {}

    bool enter(DicomTag sequence, std::int64_t item) {
        const bool groups = sequence == kSharedGroups || sequence == kFrameGroups;
        const bool wanted = path_.empty()
                                ? groups || sequence == kDetectors || sequence == kModalityTable ||
                                      sequence == kSegments
                                : path_.front() != kSegments && is_functional_group(sequence);
        if (!wanted || item < 0) {
            return wanted;
        }
        if (sequence == kFrameGroups) {
            if (item >= kMaxFrames) {
                file_.fail(0, fmt::format("the file has more than {} frames, which is the limit",
                                          kMaxFrames));
            }
            // While the list grows, old and new storage exist together, the new one with twice the
            // size.
            if (3 * sizeof(DicomPlace) * header_.per_frame.size() > max_bytes_) {
                throw Error(
                    ErrorKind::limit, {file_.name(), "PerFrameFunctionalGroupsSequence"},
                    fmt::format("the positions of more than {} frames need more than {} bytes",
                                header_.per_frame.size(), max_bytes_),
                    {{RemedyKind::more_memory}});
            }
            header_.per_frame.emplace_back();
        } else if (sequence == kSegments) {
            if (header_.segmentation.segments.size() >= kMaxSegments) {
                file_.fail(0, fmt::format("the file has more than {} segments, which is the limit",
                                          kMaxSegments));
            }
            header_.segmentation.segments.emplace_back();
        } else if (item > 0) {
            return false;
        }
        path_.push_back(sequence);
        return true;
    }
    void leave(DicomTag /*sequence*/) { path_.pop_back(); }

    /// Divides a Siemens mosaic into frames, one for each slice. The place in the header is that of
    /// a single image of the mosaic's size with the same centre (nibabel, dicom_mosaic).
    void cut_mosaic() {
        if (!is_mosaic_ || header_.frames != 1 || header_.numbers.mosaic != 1) {
            return;
        }
        const std::optional<SiemensMosaic> mosaic =
            csa_.tag == 0 || csa_.length > kMaxCsa
                ? std::nullopt
                : mosaic_of_csa(file_.bytes(csa_.at, csa_.length));
        DicomNumbers& n = header_.numbers;
        DicomPlace& place = header_.shared;
        if (!mosaic || !mosaic->normal || !place.position || !place.orientation || !place.spacing ||
            !(place.step || place.thickness)) {
            throw Error(ErrorKind::unsupported, {file_.name()},
                        "the image is a mosaic of slices (ImageType MOSAIC), but their number and "
                        "positions are unknown: the Siemens private header (0029,1010) is missing "
                        "or damaged");
        }
        const auto side =
            static_cast<std::int64_t>(std::ceil(std::sqrt(static_cast<double>(mosaic->images))));
        if (n.columns % side != 0 || n.rows % side != 0 || mosaic->images > kMaxFrames) {
            file_.fail(csa_.at, fmt::format("a mosaic of {} slices does not fit in {} x {} pixels",
                                            mosaic->images, n.columns, n.rows));
        }
        const auto& [row, column] = *place.orientation;
        const double along = dot(cross(row, column), *mosaic->normal);
        if (std::fabs(along) < 0.9) {
            file_.fail(csa_.at, "the slices of the mosaic are not stacked along their normal");
        }
        header_.mosaic_backward = along < 0;
        const std::array<double, 2> shift{
            (*place.spacing)[0] * static_cast<double>(n.columns - n.columns / side) / 2,
            (*place.spacing)[1] * static_cast<double>(n.rows - n.rows / side) / 2};
        for (std::size_t a = 0; a < 3; ++a) {
            place.position->at(a) += shift[0] * row.at(a) + shift[1] * column.at(a);
        }
        n.columns /= side;
        n.rows /= side;
        n.mosaic = static_cast<int>(side);
        header_.frames = mosaic->images;
    }

    void value(const DicomElement& e) {
        if (path_.empty()) {
            place(e, header_.shared);
            whole_image(e);
        } else if (path_.front() == kModalityTable) {
            table(e);
        } else if (path_.front() == kSegments) {
            segment(e, header_.segmentation.segments.back());
        } else if (path_.front() == kFrameGroups) {
            place(e, header_.per_frame.back());
        } else {
            place(e, path_.front() == kDetectors ? header_.detector : header_.shared);
        }
    }

  private:
    static bool is_functional_group(DicomTag sequence) {
        constexpr std::array<DicomTag, 8> kGroups{
            kSegmentOfFrame, kFrameContent,        kPlanePosition, kPlaneOrientation,
            kPixelMeasures,  kValueTransformation, kEcho,          kDiffusion};
        return std::find(kGroups.begin(), kGroups.end(), sequence) != kGroups.end();
    }
    void segment(const DicomElement& e, DicomSegment& segment) {
        switch (e.tag) {
            case 0x00620004:
                segment.number = file_.whole(e);
                break;
            case 0x00620005:
                segment.label = utf8(file_.text(e));
                break;
            case 0x0062000D:
                if (const std::vector<double> lab = binary_numbers(e, "US"); lab.size() >= 3) {
                    segment.lab = {static_cast<std::uint16_t>(lab[0]),
                                   static_cast<std::uint16_t>(lab[1]),
                                   static_cast<std::uint16_t>(lab[2])};
                }
                break;
            default:
                break;
        }
    }
    /// Character sets other than UTF-8 and Latin 1 are kept unchanged.
    [[nodiscard]] std::string utf8(const std::string& text) const {
        if (character_set_ != "ISO_IR 100") {
            return text;
        }
        std::string result;
        for (const char c : text) {
            const auto byte = static_cast<unsigned char>(c);
            if (byte < 0x80) {
                result += c;
            } else {
                result += static_cast<char>(0xC0U | byte >> 6U);
                result += static_cast<char>(0x80U | (byte & 0x3FU));
            }
        }
        return result;
    }
    void table(const DicomElement& e) {
        switch (e.tag) {
            case 0x00283002:
                if (e.length < 6) {
                    file_.fail(e.at,
                               "the descriptor of the lookup table does not have three numbers");
                }
                for (std::size_t i = 0; i < 3; ++i) {
                    table_.at(i) = number_at<std::uint16_t>(file_.bytes(e.at, 6), 2 * i,
                                                            file_.syntax().big_endian);
                }
                break;
            case 0x00283004:
                header_.table.type = file_.text(e);
                break;
            case 0x00283006:
                table_values(e);
                break;
            default:
                break;
        }
    }
    /// Entries of 8 bits take one or two bytes.
    void table_values(const DicomElement& e) {
        const std::size_t count = table_[0] == 0 ? kMaxTable : table_[0];
        const bool big = file_.syntax().big_endian;
        const bool wide = e.length >= 2 * count;
        if (e.length < count || (!wide && table_[2] > 8)) {
            file_.fail(e.at, fmt::format("the lookup table of {} values has only {} bytes", count,
                                         e.length));
        }
        const std::string all = file_.bytes(e.at, wide ? 2 * count : count + count % 2);
        header_.table.values.resize(count);
        for (std::size_t i = 0; i < count; ++i) {
            // Bytes in 16-bit words: the less significant byte of each comes first.
            const std::size_t byte = big && e.vr == "OW" ? i ^ 1U : i;
            header_.table.values[i] = wide ? number_at<std::uint16_t>(all, 2 * i, big)
                                           : static_cast<unsigned char>(all[byte]);
        }
        header_.table.first = header_.numbers.is_signed
                                  ? std::int64_t{static_cast<std::int16_t>(table_[1])}
                                  : std::int64_t{table_[1]};
        header_.numbers.table_bits = table_[2];
    }
    std::optional<double> number(const DicomElement& e) {
        const std::vector<double> all = file_.numbers(e);
        return all.empty() ? std::nullopt : std::optional(all[0]);
    }
    std::optional<std::int64_t> whole_number(const DicomElement& e) {
        const std::optional<double> value = number(e);
        return value && std::fabs(*value) < 9e15 ? std::optional(static_cast<std::int64_t>(*value))
                                                 : std::nullopt;
    }
    /// None if the element is empty, as type 2 elements may be.
    template <std::size_t N>
    std::optional<std::array<double, N>> several(const DicomElement& e) {
        const std::vector<double> all = file_.numbers(e);
        std::array<double, N> result{};
        if (all.empty()) {
            return std::nullopt;
        }
        if (all.size() < N) {
            file_.fail(e.at,
                       fmt::format("there are {} numbers, but {} are expected", all.size(), N));
        }
        std::copy_n(all.begin(), N, result.begin());
        return result;
    }
    void set_spacing(const DicomElement& e, DicomPlace& place) {
        if (const auto rows_columns = several<2>(e);
            rows_columns && (*rows_columns)[0] > 0 && (*rows_columns)[1] > 0) {
            place.spacing = {(*rows_columns)[1], (*rows_columns)[0]};
        }
    }
    void place(const DicomElement& e, DicomPlace& place) {
        switch (e.tag) {
            case 0x00200032:
                if (const auto xyz = several<3>(e)) {
                    place.position = Double3{(*xyz)[0], (*xyz)[1], (*xyz)[2]};
                }
                break;
            case 0x00200037:
                if (const auto six = several<6>(e)) {
                    place.orientation = {Double3{(*six)[0], (*six)[1], (*six)[2]},
                                         Double3{(*six)[3], (*six)[4], (*six)[5]}};
                }
                break;
            case 0x00280030:
                set_spacing(e, place);
                break;
            case 0x00180088:
                place.step = number(e);
                break;
            case 0x00180050:
                place.thickness = number(e);
                break;
            case 0x00281052:
                place.intercept = number(e);
                break;
            case 0x00281053:
                place.slope = number(e);
                break;
            case 0x0062000B:
                place.segment = file_.whole(e);
                break;
            default:
                moment(e, place.moment);
                break;
        }
    }
    /// Only used to order images at the same place: text that is not a number is ignored.
    void moment(const DicomElement& e, DicomMoment& moment) {
        struct Part {
            DicomTag tag;
            DicomMomentPart part;
            const char* vr;  ///< empty: the element's own, or text
        };
        constexpr std::array<Part, 9> kParts{{{0x00200100, DicomMomentPart::time, ""},
                                              {0x00209128, DicomMomentPart::time, "UL"},
                                              {0x00200012, DicomMomentPart::acquisition, ""},
                                              {0x00209156, DicomMomentPart::acquisition, "US"},
                                              {0x00189087, DicomMomentPart::b_value, "FD"},
                                              {0x00181060, DicomMomentPart::trigger, ""},
                                              {0x00209153, DicomMomentPart::trigger, "FD"},
                                              {0x00180086, DicomMomentPart::echo, ""},
                                              {0x00189082, DicomMomentPart::echo, "FD"}}};
        const auto* const part = std::find_if(kParts.begin(), kParts.end(),
                                              [&](const Part& p) { return p.tag == e.tag; });
        if (part == kParts.end()) {
            return;
        }
        try {
            const std::vector<double> all =
                part->vr[0] == '\0' ? file_.numbers(e) : binary_numbers(e, part->vr);
            if (!all.empty()) {
                moment.at(static_cast<std::size_t>(part->part)) = all[0];
            }
        } catch (const Error& error) {
            if (error.kind() != ErrorKind::corrupt) {
                throw;
            }
        }
    }
    /// The numbers with this VR, also if the VR is implicit.
    std::vector<double> binary_numbers(const DicomElement& e, const char* vr) {
        DicomElement binary = e;
        binary.vr = vr;
        return file_.numbers(binary);
    }
    void whole_image(const DicomElement& e) {
        DicomNumbers& n = header_.numbers;
        switch (e.tag) {
            case 0x00080005:
                character_set_ = file_.text(e);
                break;
            case 0x00080008:
                header_.localizer = has_value(e, "LOCALIZER");
                is_mosaic_ = has_value(e, "MOSAIC");
                break;
            case 0x00080018:
                header_.instance = file_.text(e);
                break;
            case 0x00080060:
                header_.modality = file_.text(e);
                break;
            case 0x0008103E:
                header_.description = file_.text(e);
                break;
            case 0x00181164:  // Imager pixel spacing, for images without another spacing.
                if (!header_.shared.spacing) {
                    set_spacing(e, header_.shared);
                }
                break;
            case 0x0020000E:
                header_.series = file_.text(e);
                break;
            case 0x00200013:
                header_.number = whole_number(e);
                break;
            case 0x00280002:
                n.samples = file_.whole(e);
                break;
            case 0x00280004:
                header_.photometric = file_.text(e);
                break;
            case 0x00280008:
                header_.frames = whole_number(e).value_or(1);
                break;
            case 0x00280010:
                n.rows = file_.whole(e);
                break;
            case 0x00280011:
                n.columns = file_.whole(e);
                break;
            case 0x00280100:
                n.allocated = file_.whole(e);
                break;
            case 0x00280101:
                n.stored = file_.whole(e);
                break;
            case 0x00280102:
                n.high = file_.whole(e);
                break;
            case 0x00280103:
                n.is_signed = file_.whole(e) == 1;
                break;
            case 0x00280120:
                header_.padding = file_.whole(e);
                break;
            case 0x00540080:
                header_.slice_numbers = binary_numbers(e, "US");
                break;
            case 0x3004000C:
                header_.grid_offsets = file_.numbers(e);
                break;
            case 0x3004000E:
                header_.dose_scaling = number(e);
                break;
            case 0x00620001:
                header_.segmentation.kind = kind_of_segmentation(file_.text(e));
                break;
            case 0x0062000E:
                header_.segmentation.most = file_.whole(e);
                break;
            default:
                private_header(e);
                break;
        }
    }
    DicomSegmentation::Kind kind_of_segmentation(const std::string& text) const {
        using Kind = DicomSegmentation::Kind;
        const Kind kind = text == "BINARY"       ? Kind::binary
                          : text == "FRACTIONAL" ? Kind::fractional
                          : text == "LABELMAP"   ? Kind::label_map
                                                 : Kind::none;
        if (kind == Kind::none) {
            throw Error(ErrorKind::unsupported, {file_.name(), "SegmentationType"},
                        fmt::format("the segmentation type '{}' is not supported", text));
        }
        return kind;
    }
    /// Whether one of the values of a text element is `value`.
    bool has_value(const DicomElement& e, std::string_view value) {
        return ("\\" + file_.text(e) + "\\").find(fmt::format("\\{}\\", value)) !=
               std::string::npos;
    }
    /// Private elements are in blocks; the first element of a block names its owner.
    void private_header(const DicomElement& e) {
        if (e.tag >> 16U != 0x0029) {
            return;
        }
        const DicomTag inside = e.tag & 0xFFFFU;
        if (inside >= 0x10 && inside <= 0xFF && file_.text(e) == "SIEMENS CSA HEADER") {
            csa_block_ = inside;
        } else if (csa_block_ != 0 && inside == (csa_block_ << 8U | 0x10U)) {
            csa_ = e;
        }
    }

    DicomFile& file_;
    DicomHeader& header_;
    std::uint64_t max_bytes_;
    std::vector<DicomTag> path_;
    /// Number of entries, first stored number, bits per value.
    std::array<std::uint16_t, 3> table_{};
    std::string character_set_;
    bool is_mosaic_ = false;  ///< according to ImageType
    DicomTag csa_block_ = 0;
    DicomElement csa_;
};

/// Whether objects of this SOP class always have pixels (PS3.3, A.3 and following; PS3.6, A):
/// slices of CT, MR and PET, and others that may hold a volume. A dose may lack them.
bool is_image_class(std::string_view uid) {
    constexpr std::string_view kStorage = "1.2.840.10008.5.1.4.1.1.";
    constexpr std::array<std::string_view, 24> kImages{
        "2",   "2.1", "2.2",  "3.1", "4",     "4.1", "4.3",    "4.4",
        "6.2", "7",   "7.1",  "7.2", "7.3",   "7.4", "13.1.1", "13.1.2",
        "20",  "30",  "66.4", "128", "128.1", "130", "481.1",  "77.1.5.4"};
    return uid.starts_with(kStorage) &&
           std::find(kImages.begin(), kImages.end(), uid.substr(kStorage.size())) != kImages.end();
}

/// In nuclear medicine, the place of a reconstruction, which has a spacing between slices, is given
/// with its detector (PS3.3, C.8.4.11 and C.8.4.15).
void use_detector(DicomHeader& header) {
    DicomPlace& place = header.shared;
    if (place.step && !place.position && !place.orientation && header.per_frame.empty()) {
        place.position = header.detector.position;
        place.orientation = header.detector.orientation;
    }
}

void check(const DicomFile& file, DicomHeader& header) {
    DicomNumbers& n = header.numbers;
    n.floating = header.pixels.tag != kPixelData;
    const auto refuse = [&](ErrorKind kind, const char* inside, const std::string& problem) {
        throw Error(kind, {file.name(), inside}, problem);
    };
    if (n.rows < 1 || n.columns < 1) {
        refuse(ErrorKind::corrupt, "Rows, Columns", "the image has no rows or no columns");
    }
    if (header.frames < 1 || header.frames > kMaxFrames) {
        refuse(ErrorKind::corrupt, "NumberOfFrames",
               fmt::format("invalid number of frames: {}", header.frames));
    }
    if (n.samples != 1 || header.photometric == "PALETTE COLOR") {
        refuse(ErrorKind::unsupported, "PhotometricInterpretation",
               fmt::format("a colour image ({}) is not a scalar volume", header.photometric));
    }
    if (n.floating) {
        n.allocated = n.stored = header.pixels.tag == kFloatPixelData ? 32 : 64;
        n.high = n.stored - 1;
    } else if (n.allocated == 1 && header.segmentation.kind == DicomSegmentation::Kind::binary) {
        n.stored = 1;
        n.high = 0;
        n.is_signed = false;
    } else if (n.allocated != 8 && n.allocated != 16 && n.allocated != 32) {
        refuse(ErrorKind::unsupported, "BitsAllocated",
               fmt::format("{} bits per number are not supported; 8, 16 and 32 are", n.allocated));
    } else if (n.stored < 1 || n.stored > n.allocated || n.high >= n.allocated ||
               n.high + 1 < n.stored) {
        refuse(ErrorKind::corrupt, "BitsStored",
               fmt::format("{} bits up to bit {} do not fit in {} bits", n.stored, n.high,
                           n.allocated));
    }
    if (!header.per_frame.empty() &&
        static_cast<std::int64_t>(header.per_frame.size()) != header.frames) {
        refuse(ErrorKind::corrupt, "PerFrameFunctionalGroupsSequence",
               fmt::format("{} frames are described, but the file has {}", header.per_frame.size(),
                           header.frames));
    }
    if (n.table_bits != 0 && (n.floating || n.allocated > 16)) {
        refuse(ErrorKind::unsupported, "ModalityLUTSequence",
               fmt::format("a lookup table for numbers of {} bits is not supported", n.allocated));
    }
    if (n.table_bits > 16 || (n.table_bits == 0 && !header.table.values.empty())) {
        refuse(ErrorKind::corrupt, "ModalityLUTSequence",
               fmt::format("invalid lookup table with values of {} bits", n.table_bits));
    }
    if (header.padding && n.is_signed) {
        header.padding = static_cast<std::int16_t>(*header.padding);
    }
}

}  // namespace

ValueType DicomNumbers::type() const {
    if (floating) {
        return allocated == 32 ? ValueType::f32 : ValueType::f64;
    }
    switch (allocated) {
        case 1:
        case 8:
            return is_signed ? ValueType::i8 : ValueType::u8;
        case 16:
            return is_signed ? ValueType::i16 : ValueType::u16;
        default:
            return is_signed ? ValueType::i32 : ValueType::u32;
    }
}

DicomNumbers DicomNumbers::whole_image() const {
    DicomNumbers whole = *this;
    whole.columns *= mosaic;
    whole.rows *= mosaic;
    whole.mosaic = 1;
    return whole;
}

ValueType DicomNumbers::value_type() const {
    return table_bits == 0                     ? type()
           : allocated == 8 && table_bits <= 8 ? ValueType::u8
                                               : ValueType::u16;
}

std::string DicomNumbers::text() const {
    return fmt::format("{} x {} of {}{} bits", columns, rows, is_signed ? "signed " : "", stored);
}

void read_dicom_header(DicomFile& file, std::uint64_t max_bytes, DicomHeader& header) {
    HeaderVisitor visitor(file, header, max_bytes);
    const DicomFile::Visitor visit{
        .value = [&](const DicomElement& e) { visitor.value(e); },
        .enter = [&](DicomTag sequence,
                     std::int64_t item) { return visitor.enter(sequence, item); },
        .leave = [&](DicomTag sequence) { visitor.leave(sequence); }};
    if (file.syntax().deflated) {
        try {
            file.visit(visit);
        } catch (const Error& error) {
            // Only the first elements are available, so the data end early.
            if (error.kind() != ErrorKind::corrupt) {
                throw;
            }
        }
        throw Error(ErrorKind::unsupported, {file.name()},
                    "a deflated DICOM file is not supported; decompress it first, for example with "
                    "gdcmconv");
    }
    header.pixels = file.visit(visit);
    if (header.pixels.tag != 0) {
        use_detector(header);
        check(file, header);
        visitor.cut_mosaic();
    } else if (is_image_class(file.class_uid())) {
        file.fail(file.size(), "the image has no pixel data; was the file cut short?");
    }
}

}  // namespace isonest::detail
