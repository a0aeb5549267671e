#define FACETCAM_ISA baseline
#include "patch.inl"
