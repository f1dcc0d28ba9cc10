#include "preprocess/hdf5_datasets.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdlib>
#include <set>
#include <tuple>

#include "store/error.h"
#include "store/handles.h"

namespace isonest {
namespace {

constexpr std::size_t kMostListed = 1000;

struct Candidate {
    std::string path;
    std::string description;
    std::size_t axes = 0;  ///< 0: not a volume
};

struct Listing {
    std::vector<Candidate> found;
    std::set<haddr_t> seen;

    [[nodiscard]] std::string text() const {
        std::string text;
        for (const Candidate& c : found) {
            text += "\n  " + c.description;
        }
        return text.empty() ? " none" : text;
    }
};

herr_t list_dataset(hid_t file, const char* name, const H5O_info_t* info, void* data) {
    auto& listing = *static_cast<Listing*>(data);
    if (info->type != H5O_TYPE_DATASET || listing.found.size() >= kMostListed ||
        !listing.seen.insert(info->addr).second) {
        return 0;
    }
    Candidate c;
    c.path = std::string("/") + name;
    const DatasetHandle dataset(H5Dopen2(file, name, H5P_DEFAULT));
    if (dataset.valid()) {
        const DatasetShape shape = shape_of(dataset.get());
        const auto type = value_type_of(dataset.get());
        c.axes = type ? shape.axes.size() : 0;
        c.description = fmt::format("{} [{}] {}", c.path, shape.text(),
                                    type ? name_of(*type) : "not a number type that is read");
    } else {
        c.description = c.path + ": HDF5 cannot open it";
    }
    listing.found.push_back(std::move(c));
    return 0;
}

Listing list_datasets(hid_t file, const std::filesystem::path& path) {
    Listing listing;
    if (H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_INC, &list_dataset, &listing, H5O_INFO_BASIC) < 0) {
        throw Error(ErrorKind::corrupt, fmt::format("{}: HDF5 cannot list its datasets: {}",
                                                    path.string(), hdf5_message()));
    }
    return listing;
}

/// Where HDF5 looks for the file of a virtual dataset's source.
std::vector<std::filesystem::path> places_of(const std::filesystem::path& source,
                                             const std::filesystem::path& file) {
    std::vector<std::filesystem::path> places{source, file.parent_path() / source};
    if (source.is_absolute()) {
        places.push_back(file.parent_path() / source.filename());
    }
    if (const char* const prefix = std::getenv("HDF5_VDS_PREFIX")) {
        places.push_back(std::filesystem::path(prefix) / source);
    }
    return places;
}

/// What HDF5 gives in a buffer of the caller's: get(null, 0) is its length.
template <class Get>
std::string text_from(const Get& get) {
    const ssize_t length = get(nullptr, 0);
    std::string text(static_cast<std::size_t>(std::max<ssize_t>(length, 0)), '\0');
    get(text.data(), text.size() + 1);
    return text;
}

/// Where HDF5 looks for the external storage of a dataset of `file`.
std::filesystem::path place_of_external(const std::filesystem::path& name,
                                        const std::filesystem::path& file) {
    const char* const prefix = std::getenv("HDF5_EXTFILE_PREFIX");
    if (prefix == nullptr) {
        return name;
    }
    constexpr std::string_view kOrigin = "${ORIGIN}";
    const std::string_view folder = prefix;
    return folder.starts_with(kOrigin) ? std::filesystem::absolute(file).parent_path().concat(
                                             folder.substr(kOrigin.size())) /
                                             name
                                       : std::filesystem::path(folder) / name;
}

std::vector<std::filesystem::path> external_files(hid_t creation, const std::filesystem::path& file,
                                                  const std::string& dataset) {
    std::vector<std::filesystem::path> files;
    for (int i = 0; i < H5Pget_external_count(creation); ++i) {
        constexpr std::size_t kLongest = 4096;
        std::string name(kLongest, '\0');
        off_t offset = 0;
        hsize_t size = 0;
        H5Pget_external(creation, static_cast<unsigned>(i), kLongest - 1, name.data(), &offset,
                        &size);
        files.push_back(place_of_external(name.c_str(), file));
        if (!std::filesystem::exists(files.back())) {
            throw Error(ErrorKind::not_found,
                        fmt::format("{}: its values are in another file, {}, which is not there",
                                    dataset, files.back().string()));
        }
    }
    return files;
}

/// What a virtual dataset takes from where: its file, the source's file as it says, the dataset.
using Mappings = std::set<std::tuple<std::filesystem::path, std::string, std::string>>;

/// Sources may be virtual themselves. `seen`: those that were followed.
void add_other_files(hid_t dataset, const std::filesystem::path& path, const std::string& name,
                     Mappings& seen, std::vector<std::filesystem::path>& files) {
    const PropertyHandle creation(H5Dget_create_plist(dataset));
    for (std::filesystem::path& file : external_files(creation.get(), path, name)) {
        files.push_back(std::move(file));
    }
    std::size_t count = 0;
    if (H5Pget_layout(creation.get()) != H5D_VIRTUAL ||
        H5Pget_virtual_count(creation.get(), &count) < 0) {
        return;
    }
    for (std::size_t i = 0; i < count; ++i) {
        const std::string file = text_from([&](char* out, std::size_t size) {
            return H5Pget_virtual_filename(creation.get(), i, out, size);
        });
        const std::string source = text_from([&](char* out, std::size_t size) {
            return H5Pget_virtual_dsetname(creation.get(), i, out, size);
        });
        const bool pattern =
            file.find('%') != std::string::npos || source.find('%') != std::string::npos;
        if (pattern || !seen.emplace(path, file, source).second) {
            continue;
        }
        FileHandle opened;
        DatasetHandle found;
        for (const std::filesystem::path& place :
             file == "." ? std::vector<std::filesystem::path>{path} : places_of(file, path)) {
            opened = open_hdf5(place);
            found = DatasetHandle(
                opened.valid() ? H5Dopen2(opened.get(), source.c_str(), H5P_DEFAULT) : -1);
            if (found.valid()) {
                files.push_back(std::filesystem::canonical(place));
                break;
            }
        }
        if (!found.valid()) {
            throw Error(ErrorKind::not_found,
                        fmt::format("{} is a virtual dataset, and of its sources {}:{} cannot be "
                                    "read; HDF5 would give the fill value in its place",
                                    name, file, source));
        }
        const std::filesystem::path place = files.back();
        add_other_files(found.get(), place, place.string() + ":" + source, seen, files);
    }
}

}  // namespace

std::optional<ValueType> value_type_of(hid_t dataset) {
    TypeHandle type(H5Dget_type(dataset));
    if (H5Tget_class(type.get()) == H5T_ENUM) {
        type = TypeHandle(H5Tget_super(type.get()));
    }
    const std::size_t size = H5Tget_size(type.get());
    if (H5Tget_class(type.get()) == H5T_FLOAT) {
        return size <= 4   ? std::optional(ValueType::f32)
               : size <= 8 ? std::optional(ValueType::f64)
                           : std::nullopt;
    }
    if (H5Tget_class(type.get()) != H5T_INTEGER || size > 8 || size == 3) {
        return std::nullopt;
    }
    if (size > 4) {
        return ValueType::f64;
    }
    const bool is_signed = H5Tget_sign(type.get()) == H5T_SGN_2;
    if (size == 1) {
        return is_signed ? ValueType::i8 : ValueType::u8;
    }
    if (size == 2) {
        return is_signed ? ValueType::i16 : ValueType::u16;
    }
    return is_signed ? ValueType::i32 : ValueType::u32;
}

std::string DatasetShape::text() const {
    return fmt::format("{}", fmt::join(dims, ", "));
}

Int3 DatasetShape::along_axes(const std::vector<hsize_t>& numbers) const {
    Int3 out{1, 1, 1};
    int axis = 0;
    for (std::size_t i = axes.size(); i-- > 0;) {
        out[axis++] = static_cast<std::int64_t>(numbers[axes[i]]);
    }
    return out;
}

std::vector<hsize_t> DatasetShape::along_dims(const Int3& numbers, hsize_t otherwise) const {
    std::vector<hsize_t> out(dims.size(), otherwise);
    int axis = 0;
    for (std::size_t i = axes.size(); i-- > 0;) {
        out[axes[i]] = static_cast<hsize_t>(numbers[axis++]);
    }
    return out;
}

DatasetShape shape_of(hid_t dataset) {
    DatasetShape shape;
    const SpaceHandle space(H5Dget_space(dataset));
    const int rank = H5Sget_simple_extent_ndims(space.get());
    if (rank < 1) {
        return shape;
    }
    shape.dims.resize(static_cast<std::size_t>(rank));
    H5Sget_simple_extent_dims(space.get(), shape.dims.data(), nullptr);
    constexpr std::size_t kMostAxes = 3;
    std::size_t surplus = shape.dims.size() - std::min(shape.dims.size(), kMostAxes);
    for (std::size_t i = 0; i < shape.dims.size(); ++i) {
        if (surplus > 0 && shape.dims[i] == 1) {
            --surplus;
        } else {
            shape.axes.push_back(i);
        }
    }
    if (surplus > 0) {
        shape.axes.clear();
    }
    return shape;
}

std::string choose_dataset(hid_t file, const std::filesystem::path& path,
                           const std::string& wanted) {
    if (!wanted.empty()) {
        const DatasetHandle dataset(H5Dopen2(file, wanted.c_str(), H5P_DEFAULT));
        if (!dataset.valid()) {
            throw Error(ErrorKind::not_found,
                        fmt::format("{}: there is no dataset {}; the file has:{}", path.string(),
                                    wanted, list_datasets(file, path).text()));
        }
        return wanted;
    }
    const Listing listing = list_datasets(file, path);
    std::size_t most = 0;
    for (const Candidate& c : listing.found) {
        most = std::max(most, c.axes);
    }
    const auto fits = [&](const Candidate& c) { return most > 0 && c.axes == most; };
    const auto count = std::count_if(listing.found.begin(), listing.found.end(), fits);
    if (count != 1) {
        throw Error(count == 0 ? ErrorKind::not_found : ErrorKind::invalid_argument,
                    fmt::format("{}: {}; the file has:{}", path.string(),
                                count == 0 ? "no dataset that is a volume"
                                           : "several volumes, choose one with --dataset",
                                listing.text()));
    }
    return std::find_if(listing.found.begin(), listing.found.end(), fits)->path;
}

std::vector<std::filesystem::path> other_files_of(hid_t dataset, const std::filesystem::path& path,
                                                  const std::string& name) {
    Mappings seen;
    std::vector<std::filesystem::path> files;
    add_other_files(dataset, path, name, seen, files);
    return files;
}

}  // namespace isonest
