// The lines of an NRRD header and the words and numbers on them, whatever they mean.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace isonest::detail {

class NrrdFields {
  public:
    /// Throws Error{corrupt} for a line that is neither a field of the format nor key:=value nor a
    /// comment, and for a field that comes twice. `name` is used in messages.
    NrrdFields(std::string_view text, std::string name);

    /// Of the header, with the empty line that ends it; 0 if none does.
    [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
    /// The field's text; null if there is none. `field` as nrrd_fields.cpp lists them.
    [[nodiscard]] const std::string* find(const char* field) const;
    /// The same; Throws Error{corrupt} if there is none.
    [[nodiscard]] const std::string& require(const char* field) const;
    /// In lower case; none if there is no such field.
    [[nodiscard]] std::vector<std::string> words(const char* field) const;
    /// "1 nan -2.5"; none if there is no such field. Throws Error{corrupt} for a word that is no
    /// number, or one that float64 does not reach.
    [[nodiscard]] std::vector<double> numbers(const char* field) const;
    /// Whole numbers. Throws Error{corrupt}; also if there is no such field.
    [[nodiscard]] std::vector<std::int64_t> integers(const char* field) const;
    /// "none (1,0,0) (0,1,0)": the numbers of each, of none no number. Throws Error{corrupt}; also
    /// if they do not have equally many.
    [[nodiscard]] std::vector<std::vector<double>> vectors(const char* field) const;

    /// Lines of key:=value whose keys begin with "Segment", which 3D Slicer writes; the last one
    /// of a key counts.
    [[nodiscard]] const std::map<std::string, std::string, std::less<>>& segment_keys() const {
        return segment_keys_;
    }

    /// Texts between quotes, in their own case; none if there is no such field.
    [[nodiscard]] std::vector<std::string> quoted(const char* field) const;

    /// Where `data file` is a list of files or a pattern of their names.
    struct Pieces {
        std::vector<std::string> files;  ///< in their order
        /// Axes that one of them has, from the fastest on; none: all but the slowest.
        std::optional<std::int64_t> axes;
    };
    /// None where it names one file, or there is no such field. Throws Error{corrupt}; also for
    /// more than kMostPieces files.
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
    std::vector<std::string> listed_;  ///< lines behind `data file: LIST`
    std::uint64_t bytes_ = 0;
};

}  // namespace isonest::detail
