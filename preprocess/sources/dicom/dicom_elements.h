// The elements of a DICOM file: tags, and where their values lie (PS3.5, sections 7 and 10 of
// PS3.10). Nothing is read that was not asked for, and no length is believed before it fits.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "preprocess/sources/bytes/byte_reader.h"

namespace isonest::detail {

/// Group and element: 0x00280010 for (0028,0010).
using DicomTag = std::uint32_t;

struct DicomElement {
    DicomTag tag = 0;
    std::string vr = {};       ///< value representation, two letters; empty where it is implicit
    std::uint64_t at = 0;      ///< first byte of the value in the file
    std::uint64_t length = 0;  ///< bytes of it
    bool undefined = false;    ///< the length is: items up to a delimiter
};

/// How the elements are encoded: from the transfer syntax.
struct DicomSyntax {
    std::string uid = {};
    bool explicit_vr = true;
    bool big_endian = false;
    /// The numbers lie in the file as they are, not as a stream of some image format.
    bool native = true;
    /// The elements are packed as a whole: of these only the first are seen.
    bool deflated = false;
};

/// The kinds of elements that hold a volume's numbers.
inline constexpr DicomTag kFloatPixelData = 0x7FE00008;
inline constexpr DicomTag kDoublePixelData = 0x7FE00009;
inline constexpr DicomTag kPixelData = 0x7FE00010;

/// A file with "DICM" after 128 bytes, or one that begins with its elements at once. Thread-safety:
/// one thread.
class DicomFile {
  public:
    /// Reads the group of the file's own data. Throws Error{io}, and Error{corrupt} for a file that
    /// is none or cut short.
    explicit DicomFile(const std::filesystem::path& path);

    [[nodiscard]] const DicomSyntax& syntax() const { return syntax_; }
    [[nodiscard]] const std::string& name() const { return name_; }
    /// The SOP class as the file's own group says; without that group, as the object does.
    [[nodiscard]] const std::string& class_uid() const { return class_uid_; }
    /// Where the elements begin that follow the file's own group.
    [[nodiscard]] std::uint64_t start() const { return start_; }

    /// What is done with the elements up to the pixel data.
    struct Visitor {
        /// A value outside of sequences, or in an item of one that was entered.
        std::function<void(const DicomElement&)> value;
        /// Whether to enter item number `item` of the sequence.
        std::function<bool(DicomTag sequence, std::int64_t item)> enter;
        std::function<void(DicomTag sequence)> leave;
    };
    /// Returns the element with the pixel data; its tag is 0 where there is none.
    /// Throws Error{corrupt, io}.
    DicomElement visit(const Visitor& visitor);

    /// A part of the file. REQUIRES: it is at most 1 MiB. Throws Error{corrupt} beyond the end.
    std::string bytes(std::uint64_t at, std::uint64_t count);
    void read(std::uint64_t at, std::byte* dst, std::uint64_t count);
    [[nodiscard]] std::uint64_t size() const { return reader_->size(); }

    /// A value that is text, without padding; less where it is longer than 64 KiB.
    std::string text(const DicomElement& element);
    /// Values that are text ("1.5\\2") or, by their VR, binary. Empty ones are left out.
    /// Throws Error{corrupt} for one that is no finite number.
    std::vector<double> numbers(const DicomElement& element);
    /// The first of unsigned 16 bits (US), or 0.
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
    std::uint64_t start_ = 0;  ///< of the elements after the file's own group
    const Visitor* visitor_ = nullptr;
    DicomElement pixels_;
    // The window of the file that was read last.
    std::string window_;
    std::uint64_t window_at_ = 0;
};

/// How many of a file's first bytes starts_as_dicom() looks at.
inline constexpr std::size_t kDicomHead = 1024;

/// Whether a file with these first bytes is DICOM: "DICM" at byte 128, or elements at once, among
/// them a SOP class that DICOM defines. No other file has such elements by chance. No I/O.
bool starts_as_dicom(std::string_view head);

/// The same of a file; false for what cannot be read.
bool is_dicom_file(const std::filesystem::path& path);

/// Whether two files hold the same object: equal bytes behind their own groups, and one encoding.
/// Throws Error{io, corrupt, unsupported}.
bool same_dicom_object(const std::filesystem::path& a, const std::filesystem::path& b);

/// Whether a file that does not begin as one looks like what is left of one: by its name (.dcm,
/// .dicom, .ima), also if it cannot be read, or zeros alone that end in or before the four letters.
bool was_dicom_file(const std::filesystem::path& path);

}  // namespace isonest::detail
