#include "store/container/writing/label_name_writer.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/base/label_text.h"
#include "store/container/codec.h"
#include "store/container/hdf5_types.h"
#include "store/container/label_table.h"

namespace isonest::detail {

/// A few rows at a time, so that they are not in memory twice.
void write_names_of_labels(const WrittenFile& file, std::span<const LabelName> names) {
    if (const std::string why = why_no_label_names(names); !why.empty() || names.empty()) {
        throw Error(ErrorKind::invalid_argument, {file.path().string()},
                    names.empty() ? "no names of labels" : why);
    }
    const std::size_t name_bytes = name_bytes_of(names);
    const TypeHandle type = label_row_type(name_bytes);
    const std::array<hsize_t, 1> all{names.size()};
    DatasetHandle table = file.create_whole(LabelTable::kPath, type.get(), all);
    Checksum sum;
    constexpr std::size_t kAtOnce = 1024;
    for (std::size_t i = 0; i < names.size(); i += kAtOnce) {
        const std::vector<std::byte> rows =
            label_rows(names.subspan(i, std::min(kAtOnce, names.size() - i)), name_bytes);
        sum.add(rows);
        const std::array<hsize_t, 1> at{i};
        const std::array<hsize_t, 1> count{std::min(kAtOnce, names.size() - i)};
        file.write_part(table, LabelTable::kPath, type.get(), at, count, rows.data());
    }
    write_attribute(table.get(), "xxh64", sum.value());
    file.close(std::move(table), LabelTable::kPath);
}

}  // namespace isonest::detail
