/* The loops of networks.c in single precision: the same text, with another type. */
#include <stdint.h>
#define double float
#define bank bank_f32
#define list list_f32
#define runs runs_f32
#include "networks.c"
