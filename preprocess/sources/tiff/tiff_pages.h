// The pages of TIFF files, and rows of their numbers. Needs libtiff.
#pragma once

#include <tiffio.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/value_type.h>

#include "preprocess/sources/wrapping/scaled_source.h"

namespace isonest::detail {

/// What all pages of a volume have in common.
struct TiffPage {
    std::int64_t width = 0;
    std::int64_t height = 0;
    std::int64_t samples = 1;  ///< per pixel
    ValueType type = ValueType::u8;
    std::optional<StoredNumber> stored;  ///< instead of the type
    bool bits = false;                   ///< each value is one bit in the file, 0 or 1
    [[nodiscard]] std::string text() const;
    bool operator==(const TiffPage&) const = default;
};

/// Keeps one file open at a time. Thread-safety: one thread.
class TiffPages {
  public:
    /// Reads the headers of all pages of all files. Uses the pages with the most frequent size and
    /// type; reduced images, masks, and previews at the beginning or end of a file are left out.
    /// Throws Error{corrupt, io, unsupported} (naming any other page that differs), Error{limit} if
    /// a strip or a row of tiles takes more than `max_heap` bytes.
    TiffPages(std::vector<std::filesystem::path> files, std::uint64_t max_heap);

    [[nodiscard]] std::int64_t count() const { return static_cast<std::int64_t>(places_.size()); }
    [[nodiscard]] const TiffPage& page() const { return page_; }
    /// Of the first page.
    [[nodiscard]] const std::string& description() const { return description_; }
    [[nodiscard]] double x_resolution() const { return resolution_[0]; }
    [[nodiscard]] double y_resolution() const { return resolution_[1]; }
    /// Maximum number of rows that are decoded together, over all pages.
    [[nodiscard]] std::int64_t rows() const { return rows_; }
    /// Bytes of memory that are held.
    [[nodiscard]] std::uint64_t heap() const;
    /// The page for a directory of a file, both by number; none if there is no such directory, or
    /// it is a smaller copy.
    [[nodiscard]] std::optional<std::int64_t> page_of(std::size_t file,
                                                      std::int64_t directory) const;
    /// Set if the first page's numbers are stored contiguously and uncompressed in the file, all
    /// samples of a pixel together, from `offset` on.
    struct Plain {
        std::uint64_t offset;
        bool big_endian;
    };
    [[nodiscard]] std::optional<Plain> plain() const { return plain_; }
    /// In MetaMorph stacks (.stk), all planes follow the first page: their number; otherwise 1.
    [[nodiscard]] std::int64_t planes_of_stack() const { return planes_of_stack_; }
    [[nodiscard]] const std::vector<std::filesystem::path>& files() const { return files_; }
    /// About what is left out, and the meaning of the values.
    [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }

    /// One sample of each pixel of row `y`, in native endianness. REQUIRES: they exist.
    void read_row(std::int64_t page, std::int64_t y, std::int64_t sample, std::byte* dst);

  private:
    struct Close {
        void operator()(TIFF* file) const { TIFFClose(file); }
    };
    struct Place {
        std::uint32_t file;
        std::uint64_t directory;  ///< file offset
        std::int64_t number;      ///< number of the directory in its file
    };
    /// Pages of the same kind.
    struct Kind {
        TiffPage page;
        std::string problem;  ///< why such pages are not read; empty: they are
        std::int64_t count = 0;
        std::int64_t rows = 1;    ///< maximum number of rows that are decoded together
        std::uint64_t bytes = 0;  ///< of these rows
        Place largest = {};       ///< a page with that many bytes
    };
    struct Seen {
        Place place;
        std::uint32_t kind;
    };
    void open(std::uint32_t file);
    void list(std::uint32_t file);
    void look_at(const Place& place);
    Kind kind_of(const Place& place);
    void choose();
    void leave_out(const Place& place, const std::string& why);
    void note_what_is_left_out();
    void read_first();
    void go_to_directory(const Place& place);
    void go_to(std::int64_t page);
    void decode(std::int64_t page, std::int64_t y, std::int64_t sample);
    [[noreturn]] void fail(const Place& place, const std::string& what) const;
    [[nodiscard]] const Place& at(std::int64_t page) const {
        return places_[static_cast<std::size_t>(page)];
    }

    std::vector<std::filesystem::path> files_;
    std::uint64_t max_heap_;
    std::vector<Seen> seen_;  ///< before the choice
    std::vector<Kind> kinds_;
    std::vector<std::string> left_out_;  ///< the first ones
    std::size_t left_out_count_ = 0;
    std::vector<std::string> notes_;
    std::vector<Place> places_;
    TiffPage page_;
    std::string description_;
    std::array<double, 2> resolution_{};
    std::optional<Plain> plain_;
    std::int64_t planes_of_stack_ = 1;
    std::int64_t rows_ = 1;
    std::uint64_t buffer_bytes_ = 0;
    mutable std::string problem_;  ///< libtiff's last message
    /// Its last warning about a tag that changes the meaning of numbers.
    std::string warning_;
    std::unique_ptr<TIFF, Close> file_;
    std::uint32_t open_ = ~std::uint32_t{0};
    std::int64_t current_ = -1;   ///< the page whose directory was read
    bool tiled_ = false;          ///< of the current page
    bool separate_ = false;       ///< its samples are in separate planes
    std::int64_t part_rows_ = 1;  ///< rows per strip or tile
    // Decoded rows of a page, with all samples or one.
    std::vector<std::byte> buffer_;
    std::vector<std::byte> tile_;
    std::int64_t decoded_page_ = -1;
    std::int64_t decoded_from_ = 0;
    std::int64_t decoded_sample_ = 0;
};

}  // namespace isonest::detail
