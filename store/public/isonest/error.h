// The one exception family of isonest.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace isonest {

/// What went wrong, as a caller or a script needs to tell it apart. The numbers are the exit codes
/// of the command line tool.
enum class ErrorKind : int {
    invalid_argument = 2,  ///< the request makes no sense; nothing was touched
    not_found = 3,         ///< a file, dataset, level or field that is not there
    corrupt = 4,           ///< bytes that contradict their own format or checksum
    unsupported = 5,       ///< well formed, but not something this version can do
    io = 6,                ///< the operating system or a library refused a read or a write
    limit = 7,             ///< the work needs more memory, or a larger format, than allowed
    cancelled = 130        ///< the user interrupted the run
};

/// What the caller can change so that the call succeeds. The names are those of the options of the
/// library; a program says it in its own words.
enum class RemedyKind : std::uint8_t {
    replace_existing,     ///< allow that an existing file is replaced
    choose_dataset,       ///< SourceOptions::dataset
    describe_numbers,     ///< SourceOptions: `value` names which ("dims,type")
    place_in_world,       ///< SourceOptions: `value` names which ("spacing,origin")
    more_memory,          ///< `value`: bytes that are enough
    smaller_chunk,        ///< PreprocessOptions::chunk
    fewer_threads,        ///< `value`: how many can be had
    resume,               ///< PreprocessOptions::resume
    no_resume,            ///< without PreprocessOptions::resume
    make_fields,          ///< preprocess again with the fields in `value`, separated by commas
    other_field,          ///< name another field; `value`: which can be used
    larger_error,         ///< allow a larger error
    smaller_box,          ///< extract a part
    other_format,         ///< `value`: the formats that serve
    state_missing,        ///< SourceOptions::missing as in preprocessing
    newer_version,        ///< a newer isonest
    correct_numbers,      ///< SourceOptions contradict the file: `value` names which
    leave_out,            ///< without the option of SourceOptions that `value` names
    other_name,           ///< another name for the output
    free_space,           ///< free some space, or an output in another folder
    good_copy,            ///< a copy of the file that is not damaged
    make_store,           ///< preprocess a volume: the file is no store
    preprocess_again,     ///< make the store anew from its volume
    smaller_input_chunk,  ///< the input stored in smaller chunks
    raise_limit,          ///< raise a limit of the operating system
    same_options,         ///< the input and options of the interrupted run
    remove_leftover,      ///< delete what an interrupted run has left (the place's file)
    smaller_picture,      ///< fewer pixels
    less_memory,          ///< a smaller memory budget: the machine has not that much
    other_scale,          ///< another GraphQuery::scale
    scale_values,         ///< scale the data, or take an offset off them, before preprocessing
    graph,                ///< data in a plane: the graph, GraphQuery
    choose_index,         ///< SourceOptions::index
    choose_series,        ///< SourceOptions::series
    install_package,      ///< build with the package that `value` names
    say_unit,             ///< SourceOptions::unit, when the store is made
    world_units,          ///< lengths in world units: numbers alone
    fewer_components,     ///< SurfaceStages::components; `value`: the least triangles of one
    check_url,            ///< another URL, or other settings of what it leads to
    give_credentials,     ///< a key or a password; `value`: where it is looked for
    set_variable,         ///< of the environment; `value`: "NAME=VALUE"
    serve_ranges,         ///< a server that answers ranges, or a local copy
    try_later,            ///< the server or the way to it is overloaded or broken
    open_again,           ///< the object has changed since it was opened
    download              ///< a copy of the object on this machine
};
struct Remedy {
    RemedyKind kind;
    std::string value = {};
    bool operator==(const Remedy&) const = default;
};

/// Where: a file (or what was asked, where there is none), and the place in it.
struct ErrorPlace {
    std::string file;
    std::string inside = {};  ///< "level 2, deviation_bar, chunk 3 0 1", or nothing
};

/// Thrown at the boundaries of the library. what() is "FILE: INSIDE: PROBLEM" without the remedies.
/// Kernels never throw it. Thread-safety: const methods from any thread.
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
    /// Where there is no place to name.
    Error(ErrorKind kind, const std::string& problem, std::vector<Remedy> remedies = {})
        : Error(kind, ErrorPlace{}, problem, std::move(remedies)) {}
    [[nodiscard]] ErrorKind kind() const noexcept { return kind_; }
    [[nodiscard]] const ErrorPlace& place() const noexcept { return place_; }
    /// what() without the place.
    [[nodiscard]] const std::string& problem() const noexcept { return problem_; }
    /// Any of them may help; the most likely one first.
    [[nodiscard]] const std::vector<Remedy>& remedies() const noexcept { return remedies_; }

  private:
    ErrorKind kind_;
    ErrorPlace place_;
    std::string problem_;
    std::vector<Remedy> remedies_;
};

}  // namespace isonest
