// The exception class of isonest.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace isonest {

/// Kinds of errors that a caller or a script needs to distinguish. The numbers are the exit codes
/// of the command line tool.
enum class ErrorKind : int {
    invalid_argument = 2,  ///< the request makes no sense; nothing was changed
    not_found = 3,         ///< a file, dataset, level or field does not exist
    corrupt = 4,           ///< bytes that contradict their own format or checksum
    unsupported = 5,       ///< valid, but not supported by this version
    io = 6,                ///< the operating system or a library refused a read or a write
    limit = 7,             ///< the work needs more memory, or a larger format, than is allowed
    cancelled = 130        ///< the user interrupted the run
};

/// What the caller can change so that the call succeeds. The names are those of the library's
/// options; a program translates them into its own.
enum class RemedyKind : std::uint8_t {
    replace_existing,     ///< allow replacing an existing file
    choose_dataset,       ///< SourceOptions::dataset
    describe_numbers,     ///< SourceOptions: `value` names the options ("dims,type")
    place_in_world,       ///< SourceOptions: `value` names the options ("spacing,origin")
    more_memory,          ///< `value`: sufficient bytes
    smaller_chunk,        ///< PreprocessOptions::chunk
    fewer_threads,        ///< `value`: number of threads that can be started
    resume,               ///< PreprocessOptions::resume
    no_resume,            ///< without PreprocessOptions::resume
    make_fields,          ///< preprocess again with the fields in `value`, separated by commas
    other_field,          ///< use another field; `value`: the usable ones
    larger_error,         ///< allow a larger error
    smaller_box,          ///< extract a part
    other_format,         ///< `value`: the formats that can be used
    state_missing,        ///< SourceOptions::missing as in preprocessing
    newer_version,        ///< a newer isonest
    correct_numbers,      ///< SourceOptions contradict the file: `value` names the options
    leave_out,            ///< omit the option that `value` names
    other_name,           ///< another name for the output
    free_space,           ///< free some space, or write to another folder
    good_copy,            ///< use an undamaged copy of the file
    make_store,           ///< preprocess a volume: the file is not a store
    preprocess_again,     ///< create the store again from its volume
    smaller_input_chunk,  ///< store the input in smaller chunks
    raise_limit,          ///< raise a limit of the operating system
    same_options,         ///< use the input and options of the interrupted run
    remove_leftover,      ///< delete what an interrupted run left behind (the file of the place)
    smaller_picture,      ///< fewer pixels
    less_memory,          ///< a smaller memory budget: the machine has less memory than that
    other_scale,          ///< another GraphQuery::scale
    scale_values,         ///< scale the data, or subtract an offset, before preprocessing
    graph,                ///< for data in a plane: extract the graph, GraphQuery
    choose_index,         ///< SourceOptions::index
    choose_series,        ///< SourceOptions::series
    install_package,      ///< build with the package that `value` names
    say_unit,             ///< SourceOptions::unit, when the store is created
    world_units,          ///< give lengths in world units, as plain numbers
    fewer_components,  ///< SurfaceStages::components; `value`: the minimum number of triangles of a
                       ///< component
    check_url,         ///< another URL, or other settings of the server behind it
    give_credentials,  ///< a key or a password; `value`: where isonest looks for it
    set_variable,      ///< set an environment variable; `value`: "NAME=VALUE"
    serve_ranges,      ///< use a server that supports range requests, or a local copy
    try_later,         ///< the server or the connection is overloaded or broken
    open_again,        ///< the object has changed since it was opened
    download           ///< make a local copy of the object
};
struct Remedy {
    RemedyKind kind;
    std::string value = {};
    bool operator==(const Remedy&) const = default;
};

/// Where the error occurred: a file (or the request, if there is no file), and a position in it.
struct ErrorPlace {
    std::string file;
    std::string inside = {};  ///< "level 2, deviation_bar, chunk 3 0 1", or empty
};

/// Thrown at the boundaries of the library; kernels never throw it. what() is "FILE: INSIDE:
/// PROBLEM" without the remedies. Thread-safety: const methods from any thread.
class Error : public std::runtime_error {
  public:
    Error(ErrorKind kind, ErrorPlace place, const std::string& problem,
          std::vector<Remedy> remedies = {})
        : std::runtime_error((place.file.empty() ? "" : place.file + ": ") +
                             (place.inside.empty() ? "" : place.inside + ": ") + problem),
          kind_(kind),
          place_(std::move(place)),
          problem_(problem),
          remedies_(std::move(remedies)) {}
    /// For errors without a place.
    Error(ErrorKind kind, const std::string& problem, std::vector<Remedy> remedies = {})
        : Error(kind, ErrorPlace{}, problem, std::move(remedies)) {}
    [[nodiscard]] ErrorKind kind() const noexcept { return kind_; }
    [[nodiscard]] const ErrorPlace& place() const noexcept { return place_; }
    /// what() without the place.
    [[nodiscard]] const std::string& problem() const noexcept { return problem_; }
    /// Alternatives; the most likely one first.
    [[nodiscard]] const std::vector<Remedy>& remedies() const noexcept { return remedies_; }

  private:
    ErrorKind kind_;
    ErrorPlace place_;
    std::string problem_;
    std::vector<Remedy> remedies_;
};

}  // namespace isonest
