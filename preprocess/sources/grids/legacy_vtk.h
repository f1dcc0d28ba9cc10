// Legacy VTK files: their lines and their header.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/value_type.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/wrapping/scaled_source.h"

namespace isonest::detail {

// The lines of legacy VTK files, and what lies between them.

/// Reads from a position that each call advances. At the end of the file it reads nothing, without
/// an error. All calls throw Error{io}; those that read lines throw Error{corrupt} for a line of
/// more than 4 KiB. REQUIRES: the file outlives this object.
class LegacyText {
  public:
    explicit LegacyText(const InputFile& file);
    /// The next line without its line end; empty at the end of the file.
    std::string line();
    /// The words of the next line that has any; empty at the end of the file.
    std::vector<std::string> words();
    void skip_to_empty_line();
    void skip(std::uint64_t bytes);
    /// Skips words of any length, across lines, up to the start of the next one.
    void skip_words(std::uint64_t count);
    void skip_lines(std::uint64_t count);
    /// Skips texts, each preceded by its length.
    void skip_binary_texts(std::uint64_t count);
    [[nodiscard]] std::uint64_t at() const { return at_; }

  private:
    const InputFile& file_;
    std::uint64_t size_;
    std::uint64_t at_ = 0;
};

// The header of legacy VTK images and rectilinear grids, and where the arrays are.

/// A type by its name in lower case, as stored in binary files; indices (vtkIdType) are stored as
/// int.
struct LegacyType {
    const char* name;
    ValueType type;
    std::optional<StoredNumber> stored;  ///< for types that volumes do not have
    [[nodiscard]] std::uint64_t bytes() const { return stored ? 8 : size_of(type); }
};
/// Null for types that cannot be read.
const LegacyType* legacy_type(const std::string& name);

struct LegacyArray {
    std::string name;
    std::string type;  ///< "unsigned_short", in lower case
    std::int64_t components = 1;
    std::int64_t tuples = 0;
    std::uint64_t at = 0;  ///< file offset of the numbers
    bool of_cells = false;
    bool colours = false;  ///< COLOR_SCALARS: in text files, fractions of 255
};

struct LegacyHeader {
    bool text = false;
    bool rectilinear = false;  ///< has coordinates in place of spacing and origin
    std::array<std::int64_t, 3> dimensions{1, 1, 1};
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};
    std::array<LegacyArray, 3> coordinates;  ///< of points, along x, y and z, if rectilinear
    LegacyArray array;
};

/// Finds the named array of points or cells, or the first one. Names may be given as VTK shows them
/// or as they are written ("my%20array"). Throws Error{corrupt, unsupported, not_found, io}.
LegacyHeader read_legacy_header(const InputFile& file, const std::string& wanted);

}  // namespace isonest::detail
