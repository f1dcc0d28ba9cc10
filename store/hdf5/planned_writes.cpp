#include "store/hdf5/planned_writes.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <memory>
#if H5_VERSION_GE(1, 13, 0)
#include <H5FDdevelop.h>
#endif

#include "store/files/open_shared.h"

namespace isonest::detail {
namespace {

/// What the driver is told when it opens a file. HDF5 copies it.
struct WritesToPlan {
    PlannedWrites* writes = nullptr;
};

/// HDF5 sees its first member.
struct PlannedFile {
    H5FD_t base{};
    PlannedWrites* writes = nullptr;
    int fd = -1;
    haddr_t end_of_space = 0;  ///< of what HDF5 has allocated
    haddr_t end_of_file = 0;   ///< as if nothing had been dropped
    struct stat status {};
};

PlannedFile& planned(H5FD_t* file) {
    return *reinterpret_cast<PlannedFile*>(file);
}
const PlannedFile& planned(const H5FD_t* file) {
    return *reinterpret_cast<const PlannedFile*>(file);
}

/// Says it as HDF5's own driver does, so that hdf5_message() finds the system's words.
herr_t report(const char* what, int error) {
    H5Epush2(H5E_DEFAULT, __FILE__, "planned_writes", __LINE__, H5E_ERR_CLS, H5E_VFL,
             H5E_WRITEERROR, "%s: error message = '%s'", what, std::strerror(error));
    return -1;
}

H5FD_t* open_planned(const char* name, unsigned flags, hid_t access, haddr_t /*most*/) {
    const auto has = [&](unsigned flag) { return (flags & flag) != 0; };
    const int how = (has(H5F_ACC_RDWR) ? O_RDWR : O_RDONLY) | (has(H5F_ACC_CREAT) ? O_CREAT : 0) |
                    (has(H5F_ACC_EXCL) ? O_EXCL : 0) | (has(H5F_ACC_TRUNC) ? O_TRUNC : 0);
    auto file = std::make_unique<PlannedFile>();
    file->fd = open_shared(name, how | O_CLOEXEC, 0666);
    if (file->fd < 0) {
        report("unable to open file", errno);
        return nullptr;
    }
    const auto* const info = static_cast<const WritesToPlan*>(H5Pget_driver_info(access));
    if (info == nullptr || ::fstat(file->fd, &file->status) != 0) {
        report("unable to look at the file", errno);
        ::close(file->fd);
        return nullptr;
    }
    file->writes = info->writes;
    file->end_of_file = static_cast<haddr_t>(file->status.st_size);
    return &file.release()->base;
}

herr_t close_planned(H5FD_t* file) {
    const std::unique_ptr<PlannedFile> owned(&planned(file));
    return ::close(owned->fd) == 0 ? 0 : report("unable to close file", errno);
}

int compare_planned(const H5FD_t* a, const H5FD_t* b) {
    const struct stat& left = planned(a).status;
    const struct stat& right = planned(b).status;
    if (left.st_dev != right.st_dev) {
        return left.st_dev < right.st_dev ? -1 : 1;
    }
    return left.st_ino == right.st_ino ? 0 : left.st_ino < right.st_ino ? -1 : 1;
}

/// Those of the default driver that say how space is allocated.
herr_t query_planned(const H5FD_t* /*file*/, unsigned long* flags) {
    *flags = H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_ACCUMULATE_METADATA | H5FD_FEAT_DATA_SIEVE |
             H5FD_FEAT_AGGREGATE_SMALLDATA | H5FD_FEAT_DEFAULT_VFD_COMPATIBLE;
    return 0;
}

haddr_t end_of_space(const H5FD_t* file, H5FD_mem_t /*kind*/) {
    return planned(file).end_of_space;
}
herr_t set_end_of_space(H5FD_t* file, H5FD_mem_t /*kind*/, haddr_t end) {
    planned(file).end_of_space = end;
    return 0;
}
haddr_t end_of_file(const H5FD_t* file, H5FD_mem_t /*kind*/) {
    return planned(file).end_of_file;
}

/// Zeros past the end.
herr_t read_planned(H5FD_t* file, H5FD_mem_t /*kind*/, hid_t /*transfer*/, haddr_t from,
                    std::size_t size, void* to) {
    auto* out = static_cast<std::byte*>(to);
    while (size > 0) {
        const ssize_t n = ::pread(planned(file).fd, out, size, static_cast<off_t>(from));
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n < 0) {
            return report("file read failed", errno);
        }
        if (n == 0) {
            std::fill_n(out, size, std::byte{0});
            return 0;
        }
        out += n;
        from += static_cast<haddr_t>(n);
        size -= static_cast<std::size_t>(n);
    }
    return 0;
}

herr_t write_planned(H5FD_t* file, H5FD_mem_t kind, hid_t /*transfer*/, haddr_t to,
                     std::size_t size, const void* from) {
    PlannedFile& f = planned(file);
    f.end_of_file = std::max(f.end_of_file, to + size);
    if (kind == H5FD_MEM_DRAW && f.writes->drops_raw) {
        f.writes->last = to;
        return 0;
    }
    const auto* bytes = static_cast<const std::byte*>(from);
    while (size > 0) {
        const ssize_t n = ::pwrite(f.fd, bytes, size, static_cast<off_t>(to));
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n <= 0) {
            return report("file write failed", n == 0 ? ENOSPC : errno);
        }
        bytes += n;
        to += static_cast<haddr_t>(n);
        size -= static_cast<std::size_t>(n);
    }
    return 0;
}

herr_t truncate_planned(H5FD_t* file, hid_t /*transfer*/, hbool_t /*closing*/) {
    PlannedFile& f = planned(file);
    if (f.end_of_space != f.end_of_file) {
        if (::ftruncate(f.fd, static_cast<off_t>(f.end_of_space)) != 0) {
            return report("unable to extend file properly", errno);
        }
        f.end_of_file = f.end_of_space;
    }
    return 0;
}

H5FD_class_t driver_class() {
    constexpr haddr_t kMostAddress = (haddr_t{1} << 63U) - 1;
    H5FD_class_t c{};
#if H5_VERSION_GE(1, 13, 0)
    c.version = H5FD_CLASS_VERSION;
    c.value = static_cast<H5FD_class_value_t>(600);  // of those that are free for own drivers
#endif
    c.name = "isonest_planned";
    c.maxaddr = kMostAddress;
    c.fc_degree = H5F_CLOSE_WEAK;
    c.fapl_size = sizeof(WritesToPlan);
    c.open = open_planned;
    c.close = close_planned;
    c.cmp = compare_planned;
    c.query = query_planned;
    c.get_eoa = end_of_space;
    c.set_eoa = set_end_of_space;
    c.get_eof = end_of_file;
    c.read = read_planned;
    c.write = write_planned;
    c.truncate = truncate_planned;
    constexpr H5FD_mem_t kMap[] = H5FD_FLMAP_DICHOTOMY;
    std::copy(std::begin(kMap), std::end(kMap), std::begin(c.fl_map));
    return c;
}

}  // namespace

void use_planned_writes(const PropertyHandle& access, PlannedWrites& writes) {
    static const H5FD_class_t kind = driver_class();
    static const hid_t driver = H5FDregister(&kind);
    const WritesToPlan info{&writes};
    H5Pset_driver(access.get(), driver, &info);
}

}  // namespace isonest::detail
