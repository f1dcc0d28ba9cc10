// What a file format has to say of itself so that open_volume() can use it.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// What the caller named: a file, a folder, or several files.
struct VolumeInput {
    std::vector<std::filesystem::path> paths;  ///< at least one, in the caller's order
    bool folder = false;                       ///< paths[0] is one
    bool far = false;                          ///< paths are URLs
    /// Of a URL that names an object: that. Null for files, and for what is taken for a folder.
    std::shared_ptr<const StoreBytes> bytes = nullptr;
    /// The start of paths[0], up to kHeadBytes; empty for a folder.
    std::string head = {};
    /// The same of what gzip holds, where the file is gzip; else as `head`.
    std::string unpacked = {};
    [[nodiscard]] bool gzip() const { return unpacked != head; }
    static constexpr std::size_t kHeadBytes = 1024;
    [[nodiscard]] const std::filesystem::path& path() const { return paths.front(); }
};

/// Options of SourceOptions that mean something for a format; the others are refused.
struct FormatOptions {
    bool dataset = false;
    bool index = false;
    bool series = false;
    bool numbers = false;  ///< dims, type, big_endian, offset
};

struct VolumeFormat {
    InputFormat about;
    FormatOptions takes;
    bool several_files = false;  ///< one volume may be several files
    bool reads_urls = false;     ///< recognises() and open() take what is elsewhere, too
    /// By the first bytes, or what is in the folder. Reads little; never throws for what is
    /// damaged.
    bool (*recognises)(const VolumeInput&);
    /// Null where this build does not read it. crop, every, spacing, origin and missing are left to
    /// the caller, except that a format may look at spacing where it decides what to refuse.
    std::unique_ptr<VolumeSource> (*open)(const VolumeInput&, const SourceOptions&);
};

/// All formats, in the order in which they are asked; raw numbers, which recognise everything,
/// last.
const std::vector<VolumeFormat>& volume_formats();

}  // namespace isonest::detail
