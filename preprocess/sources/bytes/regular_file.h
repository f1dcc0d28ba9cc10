// The size of a file and bytes of it, before anything is known of its format.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {

/// `count` bytes from byte `at` on, or all where the file ends before. Throws Error{io}.
std::string first_bytes(const InputFile& file, std::size_t count, std::uint64_t at = 0);

/// Throws Error{not_found, invalid_argument, io} unless `file` is a readable regular file, or an
/// object; gives its size.
std::uint64_t regular_file_size(const InputFile& file);

/// Whether what a folder has is a regular file, or a link that leads to nothing: left out of a list
/// of files, that would be missing without a word.
bool is_file_of_folder(const std::filesystem::directory_entry& entry);

}  // namespace isonest::detail
