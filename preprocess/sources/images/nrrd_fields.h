// The lines of an NRRD header, with the words and numbers on them, without their meaning.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/volume_source.h>

#include "preprocess/sources/wrapping/scaled_source.h"

namespace isonest::detail {

// The number types of NRRD files, with all their names.

struct NrrdType {
    ValueType type;
    std::optional<StoredNumber> stored = {};  ///< overrides the type, which has the same bits
};

/// `name` in lower case; none if the format has no such type.
/// Source: http://teem.sourceforge.net/nrrd/format.html#type
std::optional<NrrdType> nrrd_type(const std::string& name);

class NrrdFields {
  public:
    /// Throws Error{corrupt} for a line that is not a field of the format, key:=value or a comment,
    /// and for a duplicate field. `name` is used in messages.
    NrrdFields(std::string_view text, std::string name);

    /// Size of the header, including the empty line that ends it; 0 if there is no such line.
    [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
    /// The field's text; null if there is none. `field`: one of those listed in nrrd_fields.cpp.
    [[nodiscard]] const std::string* find(const char* field) const;
    /// The same, but throws Error{corrupt} if there is none.
    [[nodiscard]] const std::string& require(const char* field) const;
    /// In lower case; empty if there is no such field.
    [[nodiscard]] std::vector<std::string> words(const char* field) const;
    /// "1 nan -2.5"; empty if there is no such field. Throws Error{corrupt} for a word that is not
    /// a number, or that is beyond the range of float64.
    [[nodiscard]] std::vector<double> numbers(const char* field) const;
    /// Integers. Throws Error{corrupt}, also if there is no such field.
    [[nodiscard]] std::vector<std::int64_t> integers(const char* field) const;
    /// "none (1,0,0) (0,1,0)": the numbers of each vector, empty for "none". Throws Error{corrupt},
    /// also if the vectors differ in length.
    [[nodiscard]] std::vector<std::vector<double>> vectors(const char* field) const;

    /// Lines key:=value whose keys begin with "Segment", which 3D Slicer writes; the last one for a
    /// key is kept.
    [[nodiscard]] const std::map<std::string, std::string, std::less<>>& segment_keys() const {
        return segment_keys_;
    }

    /// Quoted texts, with their case preserved; empty if there is no such field.
    [[nodiscard]] std::vector<std::string> quoted(const char* field) const;

    /// Used if `data file` is a list of files or a pattern of names.
    struct Pieces {
        std::vector<std::string> files;  ///< in order
        /// Number of axes that one file contains, from the fastest; none: all except the slowest.
        std::optional<std::int64_t> axes;
    };
    /// None if the field names a single file or does not exist. Throws Error{corrupt}, also for
    /// more than kMaxPieces files.
    [[nodiscard]] std::optional<Pieces> pieces() const;

    [[noreturn]] void corrupt(const std::string& what) const;
    [[noreturn]] void unsupported(const std::string& what) const;

  private:
    void add(std::string_view line, std::size_t number);
    [[nodiscard]] bool lists_files() const;
    [[nodiscard]] std::int64_t integer(const char* field, std::string_view word) const;
    [[nodiscard]] double number(const char* field, std::string_view word) const;

    std::string name_;
    std::map<std::string, std::string, std::less<>> fields_;
    std::map<std::string, std::string, std::less<>> segment_keys_;
    std::vector<std::string> listed_;  ///< the lines after `data file: LIST`
    std::uint64_t bytes_ = 0;
};

}  // namespace isonest::detail
