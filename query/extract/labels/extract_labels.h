// Extracts the surfaces of labels: one surface net for all smooth ones, and a mesh for each; also
// at several levels of detail, as files in Neuroglancer's format.
#pragma once

#include <span>
#include <vector>

#include <isonest/label_name.h>
#include <isonest/labels.h>
#include <isonest/store.h>

namespace isonest::detail {

/// What the store knows of these labels, in their order.
std::vector<LabelName> known_of(const Store& store, std::span<const Label> labels);
/// Names of these labels, in their order; empty if none has one.
std::vector<LabelName> names_of(const Store& store, std::span<const Label> labels);

}  // namespace isonest::detail
