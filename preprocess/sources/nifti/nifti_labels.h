// Names and colours of labels in the extensions of a NIfTI header.
#pragma once

#include <cstddef>
#include <cstdint>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/label_names/found_labels.h"

namespace isonest::detail {

/// Where the extensions of a header lie, in the unpacked file.
struct NiftiExtensions {
    InputFile file;
    std::uint64_t begin = 0;  ///< of the four bytes that say whether there are any
    std::uint64_t end = 0;    ///< the numbers begin here, or the file ends before
    bool big_endian = false;
};

/// The <LabelTable> of Caret's XML, of the volume number `volume` of the file (the fourth axis).
/// Connectome Workbench writes it as an extension with code 30, others with code 0. What of it
/// cannot be read is left out, with a note. Nothing is looked for behind an extension whose size
/// cannot be, and beyond 16 MiB. Sources:
/// https://nifti.nimh.nih.gov/nifti-1/documentation/nifti1fields/nifti1fields_pages/extension.html,
/// https://www.nitrc.org/projects/cifti (the element LabelTable).
/// Throws Error{io}, and Error{corrupt} for gzip that is damaged there.
FoundLabels labels_of_nifti(const NiftiExtensions& where, std::int64_t volume);

}  // namespace isonest::detail
