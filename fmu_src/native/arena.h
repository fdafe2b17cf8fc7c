/* Memory that is laid out twice: once without a base, to learn how much it is, and once for good. */
#ifndef RIGTWIN_ARENA_H
#define RIGTWIN_ARENA_H

#include <stddef.h>

typedef struct {
    char *base; /* 0: only measuring */
    size_t used;
} Arena;

/* Room for some things of a size; 0 while measuring. */
static inline void *arena_take(Arena *arena, size_t count, size_t size)
{
    const size_t at = arena->used;
    arena->used += (count * size + 15) / 16 * 16;
    return arena->base ? arena->base + at : 0;
}

#define ARENA_DOUBLES(arena, count) ((double *)arena_take(arena, (size_t)(count), sizeof(double)))
#define ARENA_INTS(arena, count) ((int *)arena_take(arena, (size_t)(count), sizeof(int)))

#endif
