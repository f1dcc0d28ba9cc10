// The dialects of HDF5, each by the two questions of hdf5_dialect.h. Private to preprocess.
#pragma once

#include <fmt/format.h>

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/hdf5/hdf5_dialect.h"

namespace isonest::detail {

/// A dataset that somebody asks about.
struct DialectQuestion {
    const NamedDataset& of;
    const std::vector<std::string>& path;  ///< in the file
    const std::vector<hsize_t>& dims;
    bool with_spacing;
};

std::optional<DialectChoice> minc_choice(hid_t file, const std::string& name,
                                         const std::vector<AxisIndex>& index);
std::optional<DialectChoice> itk_choice(hid_t file, const std::string& name,
                                        const std::vector<AxisIndex>& index);
std::optional<DialectChoice> imaris_choice(hid_t file, const std::string& name,
                                           const std::vector<AxisIndex>& index);
std::optional<DialectChoice> chimera_choice(hid_t file, const std::string& name,
                                            const std::vector<AxisIndex>& index);
std::optional<DialectChoice> hyperspy_choice(hid_t file, const std::string& name,
                                             const std::vector<AxisIndex>& index);
std::optional<DialectChoice> velox_choice(hid_t file, const std::string& name,
                                          const std::vector<AxisIndex>& index);

std::optional<Hdf5Dialect> minc_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> itk_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> imaris_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> chimera_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> hyperspy_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> velox_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> ilastik_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> emd_dialect(const DialectQuestion& asked);

/// The file is of a dialect, but what this needs is missing or wrong.
[[noreturn]] inline void refuse_dialect(std::string_view dialect, const std::string& name,
                                        const std::string& problem) {
    throw Error(ErrorKind::corrupt, {name}, fmt::format("this is {}, but {}", dialect, problem));
}

}  // namespace isonest::detail
