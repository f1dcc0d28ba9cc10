#!/usr/bin/env python3
"""Valid random files of DICOM, NIfTI, MetaImage, MRC and MGH, read by isonest: every value, where each node lies, the unit.

Judges are pydicom, nibabel, VTK and mrcfile, and the numbers that were written where none of them can tell. Files that must not be
taken for an even volume (gaps, doubled slices, tilts, ...) have to be refused, with the reason in the message.
"""
import sys

import attack
from medical import dicom, dicom_kinds, dicom_odd, meta_image, mgh, mrc, nifti

if __name__ == "__main__":
    sys.exit(attack.main(__doc__, {
        "nifti": nifti.nifti, "analyze": nifti.analyze, "meta_image": meta_image.meta_image,
        "meta_image_refused": meta_image.meta_image_refused, "mrc": mrc.mrc, "mgh": mgh.mgh, "dicom": dicom.dicom,
        "dicom_frames": dicom.dicom_frames, "dicom_files_of_frames": dicom.dicom_files_of_frames,
        "dicom_nuclear": dicom.dicom_nuclear, "dicom_unplaced": dicom.dicom_unplaced, "dicom_times": dicom.dicom_times, "dicom_enhanced": dicom.dicom_enhanced,
        "dicom_bad": dicom_odd.dicom_bad, "dicom_packed": dicom_odd.dicom_packed, "dicom_bare": dicom_kinds.dicom_bare,
        "dicom_table": dicom_kinds.dicom_table, "dicom_mosaic": dicom_kinds.dicom_mosaic, "dicom_segments": dicom_kinds.dicom_segments,
        "dicom_mixed": dicom_kinds.dicom_mixed, "dicom_echoes": dicom_kinds.dicom_echoes}))
