// The elements of a DICOM file: tags, and where their values are (PS3.5, sections 7 and 10 of
// PS3.10). Only reads what is requested, and checks every length against the file before using it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/sources/bytes/byte_reader.h"

namespace isonest::detail {

/// Group and element: 0x00280010 for (0028,0010).
using DicomTag = std::uint32_t;

struct DicomElement {
    DicomTag tag = 0;
    std::string vr = {};       ///< value representation, two letters; empty if implicit
    std::uint64_t at = 0;      ///< file offset of the value's first byte
    std::uint64_t length = 0;  ///< in bytes
    bool undefined = false;    ///< of undefined length: items up to a delimiter
};

/// The encoding of the elements, given by the transfer syntax.
struct DicomSyntax {
    std::string uid = {};
    bool explicit_vr = true;
    bool big_endian = false;
    /// The numbers are stored plainly, not as a stream of an image format.
    bool native = true;
    /// The elements are compressed as a whole: only the first ones are seen.
    bool deflated = false;
};

/// The elements that can hold a volume's numbers.
inline constexpr DicomTag kFloatPixelData = 0x7FE00008;
inline constexpr DicomTag kDoublePixelData = 0x7FE00009;
inline constexpr DicomTag kPixelData = 0x7FE00010;

/// A file with "DICM" after 128 bytes, or one that begins directly with its elements.
/// Thread-safety: one thread.
class DicomFile {
  public:
    /// Reads the file meta group. Throws Error{io}, and Error{corrupt} for a file that is not DICOM
    /// or is truncated.
    explicit DicomFile(const std::filesystem::path& path);

    [[nodiscard]] const DicomSyntax& syntax() const { return syntax_; }
    [[nodiscard]] const std::string& name() const { return name_; }
    /// The SOP class in the file meta group or, without that group, in the object.
    [[nodiscard]] const std::string& class_uid() const { return class_uid_; }
    /// Where the elements after the file meta group begin.
    [[nodiscard]] std::uint64_t start() const { return start_; }

    /// Callbacks for the elements up to the pixel data.
    struct Visitor {
        /// A value outside of sequences, or in an item that was entered.
        std::function<void(const DicomElement&)> value;
        /// Whether to enter item number `item` of the sequence.
        std::function<bool(DicomTag sequence, std::int64_t item)> enter;
        std::function<void(DicomTag sequence)> leave;
    };
    /// Returns the element with the pixel data; its tag is 0 if there is none.
    /// Throws Error{corrupt, io}.
    DicomElement visit(const Visitor& visitor);

    /// A part of the file. REQUIRES: at most 1 MiB. Throws Error{corrupt} beyond the end.
    std::string bytes(std::uint64_t at, std::uint64_t count);
    void read(std::uint64_t at, std::byte* dst, std::uint64_t count);
    [[nodiscard]] std::uint64_t size() const { return reader_->size(); }

    /// A text value without padding; truncated if longer than 64 KiB.
    std::string text(const DicomElement& element);
    /// Values that are text ("1.5\\2") or, by their VR, binary. Empty ones are left out.
    /// Throws Error{corrupt} for a value that is not a finite number.
    std::vector<double> numbers(const DicomElement& element);
    /// The first unsigned 16-bit value (US), or 0.
    std::uint16_t whole(const DicomElement& element);

    /// Items of encapsulated pixel data: the offset table first, then the fragments.
    /// Throws Error{corrupt, unsupported} (more than `most`).
    std::vector<DicomElement> fragments(const DicomElement& pixels, std::size_t most);

    [[noreturn]] void fail(std::uint64_t at, const std::string& problem) const;

  private:
    struct Coding {
        bool explicit_vr;
        bool big_endian;
    };
    DicomElement element(std::uint64_t at, std::uint64_t end, const Coding& coding);
    std::uint64_t set(std::uint64_t at, std::uint64_t end, bool delimited, const Coding& coding,
                      int depth);
    std::uint64_t sequence(const DicomElement& of, std::uint64_t end, const Coding& coding,
                           int depth);
    void read_own_group(std::uint64_t at);
    void begin();
    double decimal(const DicomElement& element, const std::string& text) const;
    [[noreturn]] void refuse_number(const DicomElement& element, const std::string& text) const;

    std::string name_;
    std::unique_ptr<ByteReader> reader_;
    DicomSyntax syntax_;
    std::string class_uid_;
    std::uint64_t start_ = 0;  ///< of the elements after the file meta group
    const Visitor* visitor_ = nullptr;
    DicomElement pixels_;
    // The part of the file that was read last.
    std::string window_;
    std::uint64_t window_at_ = 0;
};

/// How many of a file's first bytes starts_as_dicom() looks at.
inline constexpr std::size_t kDicomHead = 1024;

/// Whether a file with these first bytes is DICOM: "DICM" at byte 128, or elements from the start,
/// among them a SOP class that DICOM defines, which no other file has by chance. No I/O.
bool starts_as_dicom(std::string_view head);

/// The same for a file; false if it cannot be read.
bool is_dicom_file(const std::filesystem::path& path);

/// Whether two files hold the same object: equal bytes after their file meta groups, and the same
/// encoding. Throws Error{io, corrupt, unsupported}.
bool same_dicom_object(const std::filesystem::path& a, const std::filesystem::path& b);

/// Whether a file that does not begin like DICOM looks like the remains of a DICOM file: by its
/// name (.dcm, .dicom, .ima), even if it cannot be read, or because it consists of zeros and ends
/// before or within the letters "DICM".
bool was_dicom_file(const std::filesystem::path& path);

// The private header of Siemens in MR images (CSA): a table of tags with text values. The layout is
// not published; sources: nibabel.nicom.csareader, SPM, dcm2niix.

/// An image whose plane is a square grid of slices, from left to right and from top to bottom.
struct SiemensMosaic {
    std::int64_t images = 0;             ///< number of slices; the rest of the square is empty
    std::optional<Double3> normal = {};  ///< from one slice to the next
};

/// Reads (0029,xx10) of "SIEMENS CSA HEADER"; none if it gives no number of images or is damaged.
/// Every count is checked against the available bytes. No I/O.
std::optional<SiemensMosaic> mosaic_of_csa(std::string_view csa);

}  // namespace isonest::detail
