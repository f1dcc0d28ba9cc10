#include "preprocess/sources/hdf5/hdf5_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <optional>
#include <set>
#include <sstream>
#include <utility>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

namespace fs = std::filesystem;

/// The text that HDF5 writes to a caller's buffer; get(null, 0) returns its length.
template <class Get>
std::string text_from(const Get& get) {
    const ssize_t length = get(nullptr, 0);
    std::string text(static_cast<std::size_t>(std::max<ssize_t>(length, 0)), '\0');
    get(text.data(), text.size() + 1);
    return text;
}

/// The absolute path of the folder that contains a file.
fs::path folder_of(const fs::path& file) {
    return fs::absolute(file).parent_path();
}

/// A folder in an environment variable; "${ORIGIN}/..." is relative to the folder of `file`.
fs::path expanded(const std::string& folder, const fs::path& file) {
    constexpr std::string_view kOrigin = "${ORIGIN}";
    return folder.starts_with(kOrigin) ? folder_of(file).concat(folder.substr(kOrigin.size()))
                                       : fs::path(folder);
}

/// Throws if the file exists and is not a regular file: opening a FIFO would hang.
void require_regular(const fs::path& path, const std::string& what) {
    std::error_code ignored;
    const fs::file_status status = fs::status(path, ignored);
    if (fs::exists(status) && !fs::is_regular_file(status) && !fs::is_directory(status)) {
        throw Error(ErrorKind::invalid_argument, {what},
                    fmt::format("{}, which it needs, is not a regular file", path.string()));
    }
}

using ObjectHandle = Handle<H5Oclose>;

/// What is found when links are followed. Exceptions must not pass through HDF5.
struct Links {
    std::vector<fs::path>& files;
    std::string what;
    std::optional<Error> fault;
};

herr_t note_link(const char* parent, const char* /*group*/, const char* file,
                 const char* /*object*/, unsigned* /*flags*/, hid_t /*access*/, void* data) {
    auto& links = *static_cast<Links*>(data);
    try {
        links.files.emplace_back(parent);
        for (const fs::path& place : places_of(file, parent, "HDF5_EXT_PREFIX")) {
            require_regular(place, links.what);
        }
    } catch (const Error& error) {
        links.fault = error;
        return -1;
    }
    return 0;
}

constexpr const char* kVirtual = "it is a virtual dataset whose source {}:{} {}";

/// Identifies an object by its file and its place in the file.
using ObjectId = std::pair<unsigned long, haddr_t>;

class FileSearch {
  public:
    explicit FileSearch(std::vector<fs::path>& files) : files_(files) {}

    void add(hid_t dataset, const std::string& name) {
        H5O_info_t info{};
        if (H5Oget_info2(dataset, &info, H5O_INFO_BASIC) < 0) {
            throw Error(ErrorKind::io, {name}, hdf5_message());
        }
        const ObjectId id{info.fileno, info.addr};
        if (std::find(under_way_.begin(), under_way_.end(), id) != under_way_.end()) {
            throw Error(ErrorKind::corrupt, {name}, "it is a virtual dataset and its own source");
        }
        if (!done_.insert(id).second) {
            return;
        }
        under_way_.push_back(id);
        const fs::path home = file_of(dataset);
        files_.push_back(home);
        const PropertyHandle creation(H5Dget_create_plist(dataset));
        add_storage(creation.get(), dataset, home, name);
        std::size_t count = 0;
        if (H5Pget_layout(creation.get()) == H5D_VIRTUAL &&
            H5Pget_virtual_count(creation.get(), &count) >= 0) {
            for (std::size_t i = 0; i < count; ++i) {
                add_mapping(creation.get(), i, dataset, home, name);
            }
        }
        under_way_.pop_back();
    }

  private:
    /// Adds storage in other files, which must be as long as the dataset needs.
    void add_storage(hid_t creation, hid_t dataset, const fs::path& home, const std::string& name) {
        const int count = H5Pget_external_count(creation);
        const TypeHandle type(H5Dget_type(dataset));
        const SpaceHandle space(H5Dget_space(dataset));
        std::uint64_t rest = static_cast<std::uint64_t>(
                                 std::max<hssize_t>(H5Sget_simple_extent_npoints(space.get()), 0)) *
                             H5Tget_size(type.get());
        const char* const prefix = std::getenv("HDF5_EXTFILE_PREFIX");
        for (int i = 0; i < count; ++i) {
            constexpr std::size_t kLongest = 4096;
            std::string text(kLongest, '\0');
            off_t offset = 0;
            hsize_t size = 0;
            H5Pget_external(creation, static_cast<unsigned>(i), kLongest - 1, text.data(), &offset,
                            &size);
            const fs::path file =
                (prefix != nullptr ? expanded(prefix, home) : fs::path()) / fs::path(text.c_str());
            files_.push_back(file);
            require_regular(file, name);
            std::error_code missing;
            const std::uint64_t length = fs::file_size(file, missing);
            if (missing) {
                throw Error(ErrorKind::not_found, {name},
                            fmt::format("the values are in another file, {}, which does not exist",
                                        file.string()));
            }
            const std::uint64_t part = std::min<std::uint64_t>(rest, size);
            const auto begin = static_cast<std::uint64_t>(offset);
            if (part > 0 && (length < begin || length - begin < part)) {
                throw Error(
                    ErrorKind::corrupt, {name},
                    fmt::format("{} bytes of the values are in {} from byte {} on, but that file "
                                "ends at byte {}; HDF5 would silently return zeros",
                                part, file.string(), begin, length));
            }
            rest -= part;
        }
        if (count > 0 && rest > 0) {
            throw Error(ErrorKind::corrupt, {name},
                        fmt::format("the external files lack {} bytes", rest));
        }
    }

    /// Adds the sources of one mapping: one or, for names with "%b", one for each existing block
    /// along the unlimited axis.
    void add_mapping(hid_t creation, std::size_t i, hid_t dataset, const fs::path& home,
                     const std::string& name) {
        const std::string file = text_from([&](char* out, std::size_t size) {
            return H5Pget_virtual_filename(creation, i, out, size);
        });
        const std::string source = text_from([&](char* out, std::size_t size) {
            return H5Pget_virtual_dsetname(creation, i, out, size);
        });
        const SpaceHandle taken(H5Pget_virtual_srcspace(creation, i));
        const SpaceHandle to(H5Pget_virtual_vspace(creation, i));
        Blocks blocks;
        blocks.nodes = static_cast<hsize_t>(std::max<hssize_t>(H5Sget_select_npoints(to.get()), 0));
        if (has_block(file) || has_block(source)) {
            blocks = blocks_of(to.get(), dataset);
            require_end(file, blocks.count, home, name);
        } else if (static_cast<hsize_t>(H5Sget_select_npoints(to.get())) == H5S_UNLIMITED) {
            blocks.nodes = 0;
        }
        for (hsize_t block = 0; block < blocks.count; ++block) {
            add_source(with_block(file, block), with_block(source, block),
                       {taken.get(), blocks.nodes}, dataset, home, name);
        }
    }

    /// HDF5 ignores all files of a pattern after the first missing one.
    static void require_end(const std::string& pattern, hsize_t end, const fs::path& home,
                            const std::string& name) {
        constexpr hsize_t kLookedAt = 16;
        for (hsize_t block = end + 1; has_block(pattern) && block < end + kLookedAt; ++block) {
            const std::string later = with_block(pattern, block);
            for (const fs::path& place : places_of(later, home, "HDF5_VDS_PREFIX")) {
                std::error_code ignored;
                if (fs::exists(place, ignored)) {
                    throw Error(
                        ErrorKind::not_found, {name},
                        fmt::format(
                            "it is a virtual dataset whose source {} cannot be read; HDF5 would "
                            "silently leave out all later sources, although {} exists",
                            with_block(pattern, end), place.string()));
                }
            }
        }
    }

    struct Blocks {
        hsize_t count = 1;
        hsize_t nodes = 0;  ///< in each block
    };
    /// A selection in a source, and the minimum number of nodes it must have.
    struct Taken {
        hid_t selection;
        hsize_t nodes;
    };

    /// The number of blocks in the dataset along the unlimited axis.
    static Blocks blocks_of(hid_t selection, hid_t dataset) {
        const SpaceHandle space(H5Dget_space(dataset));
        const auto rank =
            static_cast<std::size_t>(std::max(H5Sget_simple_extent_ndims(space.get()), 0));
        std::vector<hsize_t> dims(rank);
        H5Sget_simple_extent_dims(space.get(), dims.data(), nullptr);
        std::vector<hsize_t> start(rank);
        std::vector<hsize_t> stride(rank);
        std::vector<hsize_t> count(rank);
        std::vector<hsize_t> size(rank);
        if (H5Sis_regular_hyperslab(selection) <= 0 ||
            H5Sget_regular_hyperslab(selection, start.data(), stride.data(), count.data(),
                                     size.data()) < 0) {
            return {};
        }
        Blocks blocks;
        blocks.nodes = 1;
        for (std::size_t d = 0; d < rank; ++d) {
            const bool endless = count[d] == H5S_UNLIMITED;
            blocks.nodes *= endless ? size[d] : count[d] * size[d];
            if (endless && stride[d] > 0) {
                blocks.count = dims[d] <= start[d] ? 0 : (dims[d] - start[d] - 1) / stride[d] + 1;
            }
        }
        return blocks;
    }

    void add_source(const std::string& file, const std::string& path, const Taken& taken,
                    hid_t dataset, const fs::path& home, const std::string& name) {
        const std::string where = fmt::format("{}:{}", file, path);
        FileHandle opened;
        if (file == ".") {
            opened = FileHandle(H5Iget_file_id(dataset));
        } else {
            for (const fs::path& place : places_of(file, home, "HDF5_VDS_PREFIX")) {
                require_regular(place, name);
                opened = open_hdf5(place);
                if (opened.valid()) {
                    files_.push_back(place);
                    break;
                }
            }
        }
        const PropertyHandle access(H5Pcreate(H5P_DATASET_ACCESS));
        const DatasetHandle found =
            opened.valid() ? open_dataset(opened.get(), path, access, files_) : DatasetHandle();
        if (!found.valid()) {
            throw Error(
                ErrorKind::not_found, {name},
                fmt::format(kVirtual, file, path,
                            "cannot be read; HDF5 would silently return the fill value instead"));
        }
        const SpaceHandle space(H5Dget_space(found.get()));
        if (!holds(space.get(), taken)) {
            throw Error(
                ErrorKind::corrupt, {name},
                fmt::format(kVirtual, file, path, "has fewer values than are taken from it"));
        }
        add(found.get(), where);
    }

    static bool has_block(const std::string& name) {
        return with_block(name, 0) != with_block(name, 1);
    }

    /// As HDF5 interprets a pattern: "%b" is the number of the block, "%%" is "%".
    static std::string with_block(const std::string& pattern, hsize_t block) {
        std::string name;
        for (std::size_t i = 0; i < pattern.size(); ++i) {
            const bool is_sign = pattern[i] == '%' && i + 1 < pattern.size();
            i += is_sign ? 1 : 0;
            name +=
                is_sign && pattern[i] == 'b' ? std::to_string(block) : std::string(1, pattern[i]);
        }
        return name;
    }

    /// Whether the whole selection lies in the source at its current size.
    static bool holds(hid_t source, const Taken& part) {
        const hid_t taken = part.selection;
        const int rank = H5Sget_simple_extent_ndims(source);
        const int taken_rank = H5Sget_simple_extent_ndims(taken);
        if (H5Sget_select_type(taken) == H5S_SEL_ALL) {
            return static_cast<hsize_t>(H5Sget_simple_extent_npoints(source)) >= part.nodes;
        }
        if (rank != taken_rank || rank < 1) {
            return rank == taken_rank;
        }
        std::vector<hsize_t> dims(static_cast<std::size_t>(rank));
        std::vector<hsize_t> first(dims.size());
        std::vector<hsize_t> last(dims.size());
        H5Sget_simple_extent_dims(source, dims.data(), nullptr);
        if (H5Sget_select_npoints(taken) == static_cast<hssize_t>(H5S_UNLIMITED) ||
            H5Sget_select_bounds(taken, first.data(), last.data()) < 0) {
            return true;  // as far as the source extends
        }
        for (std::size_t d = 0; d < dims.size(); ++d) {
            if (last[d] >= dims[d]) {
                return false;
            }
        }
        return true;
    }

    std::vector<fs::path>& files_;
    std::set<ObjectId> done_;
    std::vector<ObjectId> under_way_;
};

/// Opens the object as a dataset; invalid, with the reason, if it is not one.
DatasetHandle dataset_of(const ObjectHandle& object, hid_t file, const std::string& path,
                         const PropertyHandle& access, std::string* reason) {
    DatasetHandle dataset;
    std::string message = object.valid() ? "it is not a dataset" : hdf5_message();
    if (object.valid() && H5Iget_type(object.get()) == H5I_DATASET) {
        dataset = DatasetHandle(H5Dopen2(file, path.c_str(), access.get()));
        message = hdf5_message();
    }
    if (reason != nullptr) {
        *reason = message;
    }
    return dataset;
}

}  // namespace

std::vector<fs::path> places_of(const fs::path& name, const fs::path& file, const char* variable) {
    std::vector<fs::path> places;
    fs::path rest = name;
    if (name.is_absolute()) {
        places.push_back(name);
        rest = name.filename();
    }
    if (const char* const folders = std::getenv(variable)) {
        std::istringstream in(folders);
        for (std::string folder; std::getline(in, folder, ':');) {
            if (!folder.empty()) {
                places.push_back(fs::path(folder) / rest);
            }
        }
        places.push_back(expanded(folders, file) / rest);
    }
    places.push_back(folder_of(file) / rest);
    places.push_back(rest);
    std::error_code ignored;
    const fs::path actual = fs::canonical(file, ignored);
    if (!actual.empty()) {
        places.push_back(actual.parent_path() / rest);
    }
    return places;
}

DatasetHandle open_dataset(hid_t file, const std::string& path, const PropertyHandle& access,
                           std::vector<fs::path>& files, std::string* reason) {
    // HDF5 keeps copies of a dataset's access properties and uses them to open the sources of a
    // virtual dataset when it is read. So the callback that records links is only set for a
    // separate opening.
    Links links{files, path, {}};
    const PropertyHandle noting(H5Pcreate(H5P_LINK_ACCESS));
    const PropertyHandle file_access(H5Pcreate(H5P_FILE_ACCESS));
    H5Pset_file_locking(file_access.get(), false, true);
    H5Pset_elink_fapl(noting.get(), file_access.get());
    H5Pset_elink_fapl(access.get(), file_access.get());
    H5Pset_elink_cb(noting.get(), &note_link, &links);
    const ObjectHandle object(H5Oopen(file, path.c_str(), noting.get()));
    if (links.fault) {
        throw Error(*links.fault);
    }
    return dataset_of(object, file, path, access, reason);
}

namespace {

herr_t refuse_link(const char* /*parent*/, const char* /*group*/, const char* file,
                   const char* /*object*/, unsigned* /*flags*/, hid_t /*access*/, void* data) {
    // Exceptions must not pass through HDF5.
    try {
        *static_cast<std::string*>(data) = file;
    } catch (...) {
        return -1;
    }
    return -1;
}

}  // namespace

DatasetHandle open_remote_dataset(hid_t file, const std::string& path, const PropertyHandle& access,
                                  std::string* reason) {
    std::string other;
    const PropertyHandle links(H5Pcreate(H5P_LINK_ACCESS));
    H5Pset_elink_cb(links.get(), &refuse_link, &other);
    const ObjectHandle object(H5Oopen(file, path.c_str(), links.get()));
    if (!other.empty()) {
        throw Error(
            ErrorKind::unsupported, {file_of(file).string(), path},
            fmt::format(
                "an external link points to another file, {:.200}, which is not opened from a URL",
                other),
            {{RemedyKind::download}});
    }
    return dataset_of(object, file, path, access, reason);
}

bool holds_its_values(hid_t dataset) {
    const PropertyHandle creation(H5Dget_create_plist(dataset));
    return creation.valid() && H5Pget_external_count(creation.get()) == 0 &&
           H5Pget_layout(creation.get()) != H5D_VIRTUAL;
}

fs::path file_of(hid_t dataset) {
    return text_from([&](char* out, std::size_t size) { return H5Fget_name(dataset, out, size); });
}

void add_files_of(hid_t dataset, const std::string& name, std::vector<fs::path>& files) {
    FileSearch(files).add(dataset, name);
    std::set<fs::path> seen;
    files.erase(std::remove_if(files.begin(), files.end(),
                               [&](const fs::path& file) { return !seen.insert(file).second; }),
                files.end());
}

}  // namespace isonest::detail
