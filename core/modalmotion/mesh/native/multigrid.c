/* What multigrid does unknown by unknown: groups, and sweeps of Gauss and Seidel.
 *
 * Matrices in compressed rows: where each begins, columns, values. */
#include "../../codec/native/export.h"

/* Put each unknown in a group of neighbours; give the number of groups.
 *
 * First each unknown whose neighbours are all free, with these; then what is left to a neighbour's
 * group; then what is left with its free neighbours. */
MM_EXPORT(mm_group)
int32_t mm_group(int64_t n, const int32_t *start, const int32_t *column, int32_t *group) {
    int32_t n_groups = 0;
    for (int64_t i = 0; i < n; i++) group[i] = -1;
    for (int64_t i = 0; i < n; i++) {
        int is_free = group[i] < 0 && start[i] < start[i + 1];
        for (int32_t e = start[i]; is_free && e < start[i + 1]; e++) is_free = group[column[e]] < 0;
        if (!is_free) continue;
        group[i] = n_groups;
        for (int32_t e = start[i]; e < start[i + 1]; e++) group[column[e]] = n_groups;
        n_groups++;
    }
    for (int64_t i = 0; i < n; i++)
        for (int32_t e = start[i]; group[i] == -1 && e < start[i + 1]; e++)
            /* Who joined in this pass is no neighbour to join. */
            if (group[column[e]] >= 0) group[i] = -2 - group[column[e]];
    for (int64_t i = 0; i < n; i++)
        if (group[i] < -1) group[i] = -2 - group[i];
    for (int64_t i = 0; i < n; i++) {
        if (group[i] >= 0) continue;
        group[i] = n_groups;
        for (int32_t e = start[i]; e < start[i + 1]; e++)
            if (group[column[e]] < 0) group[column[e]] = n_groups;
        n_groups++;
    }
    return n_groups;
}

/* Solve each row for its own unknown, in order or from the last to the first. */
MM_EXPORT(mm_sweep)
void mm_sweep(int64_t n, const int32_t *start, const int32_t *column, const double *value,
              const double *right, double *x, int64_t backward) {
    for (int64_t k = 0; k < n; k++) {
        const int64_t i = backward ? n - 1 - k : k;
        double left = right[i], diagonal = 1.0;
        for (int32_t e = start[i]; e < start[i + 1]; e++) {
            if (column[e] == i)
                diagonal = value[e];
            else
                left -= value[e] * x[column[e]];
        }
        x[i] = left / diagonal;
    }
}
