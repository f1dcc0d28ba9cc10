// The options of preprocess, and what it does for one store and for a series.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <isonest/open_volume.h>
#include <isonest/preprocess.h>
#include <isonest/tolerance.h>

#include "store/ranks/communicator.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/series_options.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {

struct PreprocessArguments {
    std::vector<std::string> input;
    std::string store;
    SourceOptions source;
    PreprocessOptions preprocess;
    std::string scratch;           ///< folder for temporary files, with several ranks
    std::vector<std::string> own;  ///< "NAME=FILE"
    ValueTolerance tolerance = {};
    std::optional<NewTimes> times;  ///< of a series
    bool append = false;            ///< to a series
    RemoteArguments remote;
};

/// Makes the store of the volume that a.input names. Collective if `ranks` is not null. Throws what
/// open_volume() and preprocess() throw.
Result preprocess_volume(PreprocessArguments& a, Communicator* ranks, Progress& progress);

/// Makes a series, or adds to one. Each entry of a.input is a step; if a.source.index takes its
/// whole axis of times, each position on that axis is a step. All inputs are opened and compared
/// before the first step is made. Throws what preprocess_volume() and SeriesWriter throw, and
/// Error{invalid_argument} for inputs that are not on the same grid, and for times that do not
/// ascend.
Result preprocess_series(const PreprocessArguments& a, Progress& progress);

}  // namespace isonest::detail::cli
