#include "preprocess/ranks/own_chunks.h"

#include <algorithm>

#include <isonest/field.h>

#include "preprocess/levels/pass_context.h"

namespace isonest::detail {
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

}  // namespace isonest::detail
