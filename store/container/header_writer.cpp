#include "store/container/header_writer.h"

#include <cstdint>
#include <string>
#include <vector>

#include <isonest/field.h>
#include <isonest/value_type.h>

#include "store/container/hdf5_types.h"
#include "store/container/header_digests.h"

namespace isonest::detail {

std::vector<double> vtk_direction(const Directions& direction) {
    std::vector<double> rows;
    for (std::size_t w = 0; w < 3; ++w) {
        for (const Double3& axis : direction) {
            rows.push_back(axis[w]);
        }
    }
    return rows;
}

void write_header(hid_t root, const StoreHeader& header) {
    write_attribute(root, "format", std::string(kFormatName));
    write_attribute(root, "version", std::vector<std::uint32_t>{kFormatMajor, kFormatMinor});
    const bool turned = header.direction != kAlongWorld;
    write_attribute(root, "flags",
                    (turned ? kHasDirection : std::uint32_t{0}) |
                        (header.labels ? kHasLabels : std::uint32_t{0}));
    write_attribute(root, "nodes",
                    std::vector<std::uint64_t>{static_cast<std::uint64_t>(header.nodes.x),
                                               static_cast<std::uint64_t>(header.nodes.y),
                                               static_cast<std::uint64_t>(header.nodes.z)});
    write_attribute(root, "spacing",
                    std::vector<double>(header.spacing.begin(), header.spacing.end()));
    write_attribute(root, "origin",
                    std::vector<double>(header.origin.begin(), header.origin.end()));
    write_attribute(root, "value_type", std::string(name_of(header.type)));
    write_attribute(root, "chunk", static_cast<std::uint32_t>(header.chunk));
    write_attribute(root, "compression", static_cast<std::uint32_t>(header.compression));
    write_attribute(root, "exact", static_cast<std::uint32_t>(header.exact ? 1 : 0));
    std::string fields;
    for (const Field field : header.fields) {
        fields += (fields.empty() ? "" : ",") + std::string(name_of(field));
    }
    write_attribute(root, "fields", fields);
    if (turned) {
        write_attribute(root, "direction", flat_directions(header.direction));
        write_attribute(root, "direction_xxh64", direction_digest(header.direction));
    }
    if (header.unit) {
        const std::string symbol(symbol_of(*header.unit));
        write_attribute(root, "unit", symbol);
        write_attribute(root, "unit_xxh64", text_digest(symbol));
    }
    if (header.frame != AnatomicalFrame::unknown) {
        const std::string name(name_of(header.frame));
        write_attribute(root, "frame", name);
        write_attribute(root, "frame_xxh64", text_digest(name));
    }
}

void write_vtk_attributes(hid_t group, const StoreHeader& header) {
    write_attribute(group, "Version", std::vector<std::int64_t>{1, 0});
    write_attribute(group, "Type", std::string("ImageData"));
    write_attribute(group, "WholeExtent",
                    std::vector<std::int64_t>{0, header.nodes.x - 1, 0, header.nodes.y - 1, 0,
                                              header.nodes.z - 1});
    write_attribute(group, "Origin",
                    std::vector<double>(header.origin.begin(), header.origin.end()));
    write_attribute(group, "Spacing",
                    std::vector<double>(header.spacing.begin(), header.spacing.end()));
    write_attribute(group, "Direction", vtk_direction(header.direction));
}

}  // namespace isonest::detail
