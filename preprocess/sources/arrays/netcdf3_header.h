// The header of NetCDF classic files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace isonest::detail {

struct NetcdfAttribute {
    std::string name;
    std::string text;             ///< if the attribute is text
    std::vector<double> numbers;  ///< otherwise; at most 1024
};

struct NetcdfVariable {
    std::string name;
    std::vector<std::size_t> dims;  ///< slowest first
    std::vector<NetcdfAttribute> attributes;
    int type =
        0;  ///< 1 to 11: byte, char, short, int, float, double, ubyte, ushort, uint, int64, uint64
    std::uint64_t begin = 0;  ///< file offset of its first byte
    bool record = false;      ///< its slowest axis is the record dimension
    std::uint64_t bytes = 0;  ///< of the variable, or of one of its records, without padding
};

struct NetcdfHeader {
    struct Dim {
        std::string name;
        std::uint64_t length;  ///< of the record dimension: the number of records
    };
    std::vector<Dim> dims;
    std::vector<NetcdfVariable> variables;
    std::uint64_t record_bytes = 0;  ///< from one record to the next
};

/// CDF-1 (classic), CDF-2 (64-bit offset), CDF-5 (64-bit data).
/// Source: https://docs.unidata.ucar.edu/netcdf-c/current/file_format_specifications.html
/// Throws Error{corrupt, unsupported, io}; reads up to 8 MiB of header with 200,000 items.
NetcdfHeader read_netcdf3_header(const std::filesystem::path& path);

/// Bytes of a number of this type; 0 for types that do not exist.
std::size_t netcdf_type_bytes(int type);
/// The number at byte `at`. REQUIRES: `type` exists and is not text.
double netcdf_number(std::string_view bytes, std::size_t at, int type);

}  // namespace isonest::detail
