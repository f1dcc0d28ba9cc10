// The quantities that --vertex-values names, for the vertices of extracted meshes.
#pragma once

#include <cstdint>
#include <list>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/vertex_fields.h>

#include "store/ranks/communicator.h"
#include "tools/cli/commands/input_store.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {

/// NAME=SOURCE, or NAME=SOURCE,SOURCE,SOURCE for a vector.
struct NamedValues {
    std::string name;
    std::vector<std::string> sources;  ///< stores or volumes; FILE:DATASET names a dataset
};

/// nullopt if the text is the location of a store, without a name. Throws Error{invalid_argument}
/// unless there are one or three sources.
std::optional<NamedValues> parse_named_values(const std::string& text);

/// The options for opening a source: a store, or a volume with the dataset that follows a colon.
InputArguments arguments_of_source(const std::string& source, const RemoteArguments& remote);

/// The stores of all named values, and the object that adds them to meshes.
class VertexValues {
  public:
    /// Opens the stores, and makes temporary ones of volumes. A quarter of `a.options.memory` is
    /// set aside. Sets `a.fields`, and `a.field_to_color` if there is a scalar. Collective on
    /// ranks, where all sources must be stores. `progress` must outlive it. Throws what
    /// open_store(), preprocess() and VertexFields throw.
    VertexValues(const std::vector<NamedValues>& values, ExtractArguments& a,
                 const RemoteArguments& remote, Communicator* ranks, Progress& progress);
    VertexValues(const VertexValues&) = delete;
    VertexValues& operator=(const VertexValues&) = delete;

    /// Calls run(). In errors that it throws, the minimum for --memory includes what is set aside.
    template <class Run>
    Result run(const Run& run) const {
        try {
            return run();
        } catch (const Error& error) {
            if (!fields_) {
                throw;
            }
            // A quarter is set aside.
            throw with_enough_memory(error,
                                     [](std::uint64_t enough) { return enough / 3 * 4 + 4; });
        }
    }

    /// After the extraction: adds "vertex_fields" to the JSON report, and a line of text for each.
    void report(Result& result) const;

  private:
    struct Source {
        InputArguments arguments;
        InputStore input;
    };
    std::vector<NamedValues> values_;
    std::list<Source> sources_;
    std::string mesh_;       ///< name of the output
    bool in_tiles_ = false;  ///< whether it is a tileset
    std::unique_ptr<VertexFields> fields_;
};

}  // namespace isonest::detail::cli
