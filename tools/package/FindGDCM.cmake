# GDCM::GDCM: GDCM, which decodes the frames of DICOM files, and OpenJPEG, for frames that GDCM does not support.
# Debian's CMake configuration of GDCM also needs its packages for VTK and Python.
find_path(GDCM_INCLUDE_DIR gdcmJPEGCodec.h PATH_SUFFIXES gdcm-3.1 gdcm-3.0)
find_path(GDCM_OPENJPEG_INCLUDE_DIR openjpeg.h PATH_SUFFIXES openjpeg-2.5 openjpeg-2.4)
find_library(GDCM_OPENJPEG_LIBRARY openjp2)
set(GDCM_ALL_LIBRARIES)
set(GDCM_REQUIRED GDCM_INCLUDE_DIR GDCM_OPENJPEG_INCLUDE_DIR GDCM_OPENJPEG_LIBRARY)
foreach(part IN ITEMS MSFF DSED DICT Common)
  find_library(GDCM_${part}_LIBRARY gdcm${part})
  list(APPEND GDCM_ALL_LIBRARIES ${GDCM_${part}_LIBRARY})
  list(APPEND GDCM_REQUIRED GDCM_${part}_LIBRARY)
endforeach()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(GDCM REQUIRED_VARS ${GDCM_REQUIRED})
if(GDCM_FOUND AND NOT TARGET GDCM::GDCM)
  add_library(GDCM::GDCM INTERFACE IMPORTED)
  set_target_properties(GDCM::GDCM PROPERTIES
    INTERFACE_INCLUDE_DIRECTORIES "${GDCM_INCLUDE_DIR};${GDCM_OPENJPEG_INCLUDE_DIR}"
    INTERFACE_LINK_LIBRARIES "${GDCM_ALL_LIBRARIES};${GDCM_OPENJPEG_LIBRARY}")
endif()
