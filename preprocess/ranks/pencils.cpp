#include "preprocess/ranks/pencils.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <limits>

#include <isonest/error.h>
#include <isonest/field.h>

#include "preprocess/levels/level_blocks.h"
#include "preprocess/levels/pass_context.h"
#include "store/files/open_file.h"

namespace isonest::detail {
namespace {

/// Number of blocks along one axis without those at its end that have few nodes.
std::int64_t without_thin(std::int64_t blocks, std::int64_t nodes, std::int64_t chunk) {
    while (blocks > 1 && nodes - 2 * chunk * (blocks - 1) <= chunk / 4) {
        --blocks;
    }
    return blocks;
}

/// Nodes of a block along one axis including its margin: the cost of reading and computing it. The
/// last of `blocks` has all remaining nodes.
std::uint64_t weight_along(std::int64_t block, std::int64_t blocks, std::int64_t nodes,
                           std::int64_t chunk) {
    const std::int64_t left = nodes - 2 * chunk * block;
    const std::int64_t own = block == blocks - 1 ? left : 2 * chunk;
    return static_cast<std::uint64_t>(std::max<std::int64_t>(own, 1) + kMargin);
}

}  // namespace

Pencils::Pencils(const StoreLayout& layout, int ranks)
    : layout_(&layout), base_(base_grid(layout)) {
    const Int3 nodes = layout.lattice().nodes();
    const std::int64_t chunk = layout.header().chunk;
    dealt_ = {1, without_thin(base_.y, nodes.y, chunk), without_thin(base_.z, nodes.z, chunk)};
    const auto bits_of = [](std::int64_t n) {
        return static_cast<int>(std::bit_width(static_cast<std::uint64_t>(n - 1)));
    };
    longer_is_y_ = dealt_.y >= dealt_.z;
    bits_ = std::min(bits_of(dealt_.y), bits_of(dealt_.z));
    const auto rest = static_cast<std::uint64_t>((std::max(dealt_.y, dealt_.z) - 1) >> bits_);
    const std::uint64_t end = (rest + 1) << (2 * bits_);

    const auto weight_of = [&](const Pencil& p) {
        return p.y < dealt_.y && p.z < dealt_.z ? weight_along(p.y, dealt_.y, nodes.y, chunk) *
                                                      weight_along(p.z, dealt_.z, nodes.z, chunk)
                                                : 0;
    };
    std::uint64_t total = 0;
    for (std::int64_t y = 0; y < dealt_.y; ++y) {
        total += weight_along(y, dealt_.y, nodes.y, chunk);
    }
    std::uint64_t along_z = 0;
    for (std::int64_t z = 0; z < dealt_.z; ++z) {
        along_z += weight_along(z, dealt_.z, nodes.z, chunk);
    }
    total *= along_z;
    // A rank begins at the first pencil whose middle is after its share of the total.
    first_.reserve(static_cast<std::size_t>(ranks) + 1);
    first_.push_back(0);
    const auto share_of = [&](std::size_t rank) {
        return static_cast<double>(total) * static_cast<double>(rank) / static_cast<double>(ranks);
    };
    std::uint64_t before = 0;
    for (std::uint64_t code = 0; code < end; ++code) {
        const std::uint64_t weight = weight_of(pencil_at(code));
        const double middle = static_cast<double>(before) + static_cast<double>(weight) / 2;
        while (weight > 0 && first_.size() < static_cast<std::size_t>(ranks) &&
               middle > share_of(first_.size())) {
            first_.push_back(code);
        }
        before += weight;
    }
    first_.resize(static_cast<std::size_t>(ranks), end);
    first_.push_back(end);
}

Int3 Pencils::grid(int pass) const {
    return pass == kBasePass ? base_ : coarse_grid(*layout_, pass);
}

PencilCut Pencils::chunk_cut(int pass) const {
    return {pass - kBasePass, layout_->header().chunk / 2, grid(pass)};
}

PencilCut Pencils::part_cut(int pass) const {
    constexpr std::int64_t kMinCells = 2;
    const PencilCut chunks = chunk_cut(pass);
    const std::int64_t cells = chunks.cells >> chunks.shift;
    if (cells < kMinCells || chunks.shift == 0 || ranks() == 1) {
        return chunks;
    }
    PencilCut cut{0, cells, {chunks.grid.x, 1, 1}};
    for (const ArrayInfo& array : layout_->arrays()) {
        if (array.field == Field::values && array.level == pass - 1) {
            cut.grid = max(cut.grid, ceil_div(array.nodes, {array.nodes.x, 2 * cells, 2 * cells}));
        } else if (array.field != Field::values && array.level == pass) {
            cut.grid = max(cut.grid, ceil_div(array.nodes, {array.nodes.x, cells, cells}));
        }
    }
    return cut;
}

std::uint64_t Pencils::code_of(const Pencil& pencil) const {
    const auto y = static_cast<std::uint64_t>(pencil.y);
    const auto z = static_cast<std::uint64_t>(pencil.z);
    std::uint64_t code = ((longer_is_y_ ? y : z) >> bits_) << (2 * bits_);
    for (int bit = 0; bit < bits_; ++bit) {
        code |= ((y >> bit) & 1U) << (2 * bit) | ((z >> bit) & 1U) << (2 * bit + 1);
    }
    return code;
}

Pencil Pencils::pencil_at(std::uint64_t code) const {
    std::uint64_t y = 0;
    std::uint64_t z = 0;
    for (int bit = 0; bit < bits_; ++bit) {
        y |= ((code >> (2 * bit)) & 1U) << bit;
        z |= ((code >> (2 * bit + 1)) & 1U) << bit;
    }
    (longer_is_y_ ? y : z) |= (code >> (2 * bits_)) << bits_;
    return {static_cast<std::int64_t>(y), static_cast<std::int64_t>(z)};
}

int Pencils::owner(const PencilCut& cut, const Pencil& pencil) const {
    const std::uint64_t code = code_of({std::min(pencil.y << cut.shift, dealt_.y - 1),
                                        std::min(pencil.z << cut.shift, dealt_.z - 1)});
    // If several ranks begin at the same code, all but the last have nothing.
    return static_cast<int>(std::upper_bound(first_.begin(), first_.end() - 1, code) -
                            first_.begin()) -
           1;
}

std::vector<Pencil> Pencils::of(int rank, const PencilCut& cut) const {
    const auto r = static_cast<std::size_t>(rank);
    // Pencils of the cut along an axis whose owner is that of a distributed pencil of the base
    // pass.
    struct Range {
        std::int64_t begin = 0;
        std::int64_t end = 0;
    };
    const auto above = [&](std::int64_t base, std::int64_t dealt, std::int64_t all) {
        const std::int64_t step = std::int64_t{1} << cut.shift;
        const std::int64_t begin = (base + step - 1) >> cut.shift;
        const std::int64_t end = base == dealt - 1 ? all : base % step == 0 ? begin + 1 : begin;
        return Range{begin, std::min(end, all)};
    };
    std::vector<Pencil> found;
    for (std::uint64_t code = first_[r]; code < first_[r + 1]; ++code) {
        const Pencil base = pencil_at(code);
        if (base.y >= dealt_.y || base.z >= dealt_.z) {
            continue;
        }
        const Range ys = above(base.y, dealt_.y, cut.grid.y);
        const Range zs = above(base.z, dealt_.z, cut.grid.z);
        for (std::int64_t z = zs.begin; z < zs.end; ++z) {
            for (std::int64_t y = ys.begin; y < ys.end; ++y) {
                found.push_back({y, z});
            }
        }
    }
    return found;
}

std::vector<PencilBox> Pencils::boxes(int rank) const {
    const std::vector<Pencil> own = of(rank, kBasePass);
    const PencilCut cut = chunk_cut(kBasePass);
    PencilBox around{std::numeric_limits<std::int64_t>::max(), 0,
                     std::numeric_limits<std::int64_t>::max(), 0};
    for (const Pencil& p : own) {
        around.y_begin = std::min(around.y_begin, p.y);
        around.y_end = std::max(around.y_end, p.y + 1);
        around.z_begin = std::min(around.z_begin, p.z);
        around.z_end = std::max(around.z_end, p.z + 1);
    }
    std::vector<PencilBox> found;
    for (std::int64_t z = around.z_begin; z < around.z_end; ++z) {
        for (std::int64_t y = around.y_begin; y < around.y_end;) {
            if (owner(cut, {y, z}) != rank) {
                ++y;
                continue;
            }
            std::int64_t end = y + 1;
            while (end < around.y_end && owner(cut, {end, z}) == rank) {
                ++end;
            }
            const auto same = std::find_if(found.begin(), found.end(), [&](const PencilBox& box) {
                return box.y_begin == y && box.y_end == end && box.z_end == z;
            });
            if (same != found.end()) {
                same->z_end = z + 1;
            } else {
                found.push_back({y, end, z, z + 1});
            }
            y = end;
        }
    }
    return found;
}

namespace {

void add_box(const ArrayInfo* array, const Int3& first, std::int64_t count,
             std::vector<ChunkPlace>& out) {
    if (array == nullptr || array->alias) {
        return;
    }
    const Int3 end = min(first + Int3{count, count, count}, array->grid);
    for (std::int64_t z = first.z; z < end.z; ++z) {
        for (std::int64_t y = first.y; y < end.y; ++y) {
            for (std::int64_t x = first.x; x < end.x; ++x) {
                out.push_back({array, {x, y, z}});
            }
        }
    }
}

void add_indicators(const StoreLayout& layout, int level, const Int3& first, std::int64_t count,
                    std::vector<ChunkPlace>& out) {
    for (const Field field : layout.header().fields) {
        add_box(find_array(layout, level, field), first, count, out);
    }
}

}  // namespace

int last_pass(const StoreLayout& layout) {
    return std::max(layout.lattice().top() + 1, kBasePass);
}

std::vector<ChunkPlace> chunks_of(const StoreLayout& layout, int pass, const Int3& block) {
    std::vector<ChunkPlace> out;
    const int top = layout.lattice().top();
    if (pass == kBasePass) {
        add_box(&layout.array(0, Field::values), block * 2, 2, out);
        add_box(find_array(layout, 1, Field::values), block, 1, out);
        add_indicators(layout, 1, block * 2, 2, out);
        add_indicators(layout, 2, block, 1, out);
    } else if (pass <= top) {
        add_box(&layout.array(pass - 1, Field::values), block, 1, out);
        add_indicators(layout, pass, block, 1, out);
    } else {
        const ArrayInfo& values = layout.array(top, Field::values);
        const Int3& grid = values.grid;
        add_box(&values, {0, 0, 0}, std::max({grid.x, grid.y, grid.z}), out);
    }
    return out;
}

OwnRows::OwnRows(const StoreLayout& layout, const Pencils& pencils, int rank)
    : layout_(&layout), pencils_(&pencils), rank_(rank), boxes_(pencils.boxes(rank)) {}

bool OwnRows::next(BlockRow& row) {
    if (box_ < boxes_.size()) {
        const PencilBox& box = boxes_[box_];
        row = {kBasePass, box.y_begin, box.y_end, box.z_begin + row_};
        if (++row_ == box.z_end - box.z_begin) {
            row_ = 0;
            ++box_;
        }
        return true;
    }
    const int last = last_pass(*layout_);
    while (at_ == coarse_.size()) {
        if (pass_ == last) {
            return false;
        }
        ++pass_;
        at_ = 0;
        coarse_ = pass_ < last                                  ? pencils_->of(rank_, pass_)
                  : pencils_->owner(kBasePass, {0, 0}) == rank_ ? std::vector<Pencil>{{0, 0}}
                                                                : std::vector<Pencil>();
    }
    const Pencil& pencil = coarse_[at_++];
    row = {pass_, pencil.y, pencil.y + 1, pencil.z};
    return true;
}

bool OwnChunks::next(ChunkPlace& place) {
    while (chunk_ == chunks_.size()) {
        while (block_ == size_.product()) {
            if (!rows_.next(row_)) {
                return false;
            }
            block_ = 0;
            size_ = {row_.pass > kBasePass && row_.pass == last_pass(*layout_)
                         ? 1
                         : pencils_->grid(row_.pass).x,
                     row_.y_end - row_.y_begin, 1};
        }
        const Int3 in_row = size_.unlinear(block_++);
        chunks_ = chunks_of(*layout_, row_.pass, {in_row.x, row_.y_begin + in_row.y, row_.z});
        chunk_ = 0;
    }
    place = chunks_[chunk_++];
    return true;
}

namespace {

constexpr std::size_t kRowsAtOnce = 4096;
constexpr std::size_t kBytesAtOnce = std::size_t{1} << 20U;

/// Copies from one file to another.
void copy_chunks(ChunkRun from, const SharedFile& to, std::uint64_t offset, std::uint64_t bytes,
                 std::vector<std::byte>& buffer, const std::filesystem::path& store) {
    while (bytes > 0) {
        const std::uint64_t most = std::min<std::uint64_t>(bytes, kBytesAtOnce);
        std::uint64_t n = to.copy_from(from.descriptor, from.offset, offset, most);
        if (n == 0) {
            buffer.resize(kBytesAtOnce);
            const auto piece = std::span(buffer).first(static_cast<std::size_t>(most));
            if (!pread_whole(from.descriptor, from.offset, piece)) {
                throw Error(
                    ErrorKind::io, {store.string()},
                    fmt::format("cannot read back its chunks: {}",
                                errno == 0 ? "the file was truncated" : std::strerror(errno)));
            }
            to.write_at(offset, piece);
            n = most;
        }
        from.offset += n;
        offset += n;
        bytes -= n;
    }
}

}  // namespace

void OwnChunkFile::add(std::span<const EncodedChunk> chunks) {
    const ChunkRun place{bytes_.descriptor(), end_};
    for (const EncodedChunk& chunk : chunks) {
        bytes_.write_at(end_, chunk.bytes);
        end_ += chunk.bytes.size();
    }
    add(chunks, place);
}

void OwnChunkFile::add(std::span<const EncodedChunk> chunks, const ChunkRun& place) {
    if (runs_.empty() || runs_.back().place.descriptor != place.descriptor ||
        runs_.back().place.offset + runs_.back().bytes != place.offset) {
        runs_.push_back({place});
    }
    for (const EncodedChunk& chunk : chunks) {
        ++runs_.back().rows;
        runs_.back().bytes += chunk.row.bytes;
        pending_.push_back(chunk.row);
        if (pending_.size() == kRowsAtOnce) {
            flush();
        }
    }
}

void OwnChunkFile::flush() {
    rows_.write_at(count_ * sizeof(ChunkRow), std::as_bytes(std::span(pending_)));
    count_ += pending_.size();
    pending_.clear();
}

std::span<ChunkRow> OwnChunkFile::rows() {
    if (!pending_.empty() || rows_.as<ChunkRow>().size() != count_) {
        flush();
        rows_.map(count_ * sizeof(ChunkRow));
    }
    return rows_.as<ChunkRow>();
}

std::uint64_t OwnChunkFile::write_into(const std::filesystem::path& store) const {
    SharedFile file(store);
    std::vector<std::byte> buffer;
    std::uint64_t written = 0;
    std::span<const ChunkRow> rows = rows_.as<ChunkRow>();
    for (const Run& run : runs_) {
        ChunkRun from = run.place;
        const std::span<const ChunkRow> of_run = rows.first(run.rows);
        rows = rows.subspan(run.rows);
        for (std::size_t i = 0; i < of_run.size();) {
            // As many chunks as are adjacent in the store, too.
            const std::uint64_t offset = of_run[i].offset;
            std::uint64_t bytes = 0;
            for (; i < of_run.size() && of_run[i].offset == offset + bytes; ++i) {
                bytes += of_run[i].bytes;
            }
            copy_chunks(from, file, offset, bytes, buffer, store);
            from.offset += bytes;
        }
        written += run.bytes;
    }
    file.close();
    return written;
}

}  // namespace isonest::detail
