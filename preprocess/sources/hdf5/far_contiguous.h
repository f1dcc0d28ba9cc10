// HDF5 datasets elsewhere that lie in one piece. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <memory>
#include <string>

#include <isonest/value_type.h>
#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/hdf5/hdf5_datasets.h"

namespace isonest::detail {

/// A type as HDF5 has it in memory (little endian), and as volumes have it.
struct Hdf5Number {
    hid_t memory_type;
    ValueType type;
};

/// The numbers by ranges, without HDF5; those of the other byte order, too. Null where they do not
/// lie so, or are stored as others: then HDF5 has to read them. Throws Error{corrupt} where the
/// object ends before them, and what open_far_numbers() throws.
std::unique_ptr<VolumeSource> open_far_contiguous(const InputFile& file, hid_t dataset,
                                                  const DatasetShape& shape,
                                                  const Hdf5Number& number,
                                                  const std::string& name);

}  // namespace isonest::detail
