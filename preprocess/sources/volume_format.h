// What a file format has to say of itself so that open_volume() can use it.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/far_objects.h"
#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {

/// What the caller named: a file, a folder, or several files.
struct VolumeInput {
    std::vector<std::filesystem::path> paths;  ///< at least one, in the caller's order
    bool folder = false;                       ///< paths[0] is one
    bool far = false;                          ///< paths are URLs
    /// How URLs are read; null for files.
    std::shared_ptr<FarObjects> elsewhere = nullptr;
    /// paths[0], or of a URL the object that it names; none of what is taken for a folder
    /// elsewhere.
    InputFile file = {};
    /// Why a URL that is taken for a folder names no object; null where its name says a folder.
    std::shared_ptr<const Error> missing = nullptr;
    /// The start of paths[0], up to kHeadBytes; empty for a folder.
    std::string head = {};
    /// The same of what gzip holds, where the file is gzip; else as `head`.
    std::string unpacked = {};
    [[nodiscard]] bool gzip() const { return unpacked != head; }
    static constexpr std::size_t kHeadBytes = 1024;
    /// REQUIRES: not for messages, if far: it may have credentials.
    [[nodiscard]] const std::filesystem::path& path() const { return paths.front(); }
    /// For messages.
    [[nodiscard]] std::string name() const;
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
    /// damaged. Formats that read no URLs are not asked about folders there.
    bool (*recognises)(const VolumeInput&);
    /// Null where this build does not read it. crop, every, spacing, origin and missing are left to
    /// the caller, except that a format may look at spacing where it decides what to refuse.
    std::unique_ptr<VolumeSource> (*open)(const VolumeInput&, const SourceOptions&);
};

/// All formats, in the order in which they are asked; raw numbers, which recognise everything,
/// last.
const std::vector<VolumeFormat>& volume_formats();

}  // namespace isonest::detail
