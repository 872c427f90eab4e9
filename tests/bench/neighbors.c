/* A plain cell list: counting sort, 3 x 3 cells, rows sorted by number; and first-fit colors. */

#include <stdint.h>
#include <string.h>

typedef struct {
    double x, y;
} Vec;

/* Grains in [-half, half]^2, cells no narrower than reach. Returns how many pairs are nearer than reach. */
int cellList(int n, const Vec *x, double reach, double half, int width, int *cellStart, int *grains, int *cells,
             int *start, int *neighbors) {
    double perCell = width / (2.0 * half);
    memset(cellStart, 0, (width * width + 1) * sizeof(int));
    for (int i = 0; i < n; i++) {
        cells[i] = (int)((x[i].x + half) * perCell) + width * (int)((x[i].y + half) * perCell);
        cellStart[cells[i] + 1]++;
    }
    for (int c = 0; c < width * width; c++)
        cellStart[c + 1] += cellStart[c];
    for (int i = n - 1; i >= 0; i--)
        grains[--cellStart[cells[i] + 1]] = i;
    for (int c = 0; c < width * width; c++)
        cellStart[c] = cellStart[c + 1];
    cellStart[width * width] = n;
    int pairs = 0;
    for (int i = 0; i < n; i++) {
        start[i] = pairs;
        int cx = cells[i] % width, cy = cells[i] / width;
        for (int ny = cy > 0 ? cy - 1 : 0; ny <= cy + 1 && ny < width; ny++) {
            int first = width * ny + (cx > 0 ? cx - 1 : 0), last = width * ny + (cx + 1 < width ? cx + 1 : cx);
            for (int k = cellStart[first]; k < cellStart[last + 1]; k++) {
                int j = grains[k];
                double dx = x[j].x - x[i].x, dy = x[j].y - x[i].y;
                if (j > i && dx * dx + dy * dy <= reach * reach) {
                    int place = pairs++;
                    for (; place > start[i] && neighbors[place - 1] > j; place--)
                        neighbors[place] = neighbors[place - 1];
                    neighbors[place] = j;
                }
            }
        }
    }
    start[n] = pairs;
    return pairs;
}

/* Returns how many colors there are, at most 64. */
int firstFit(int n, const int *start, const int *neighbors, uint64_t *used, int *color) {
    int colors = 0;
    memset(used, 0, n * sizeof(uint64_t));
    for (int i = 0; i < n; i++)
        for (int k = start[i]; k < start[i + 1]; k++) {
            int j = neighbors[k];
            color[k] = __builtin_ctzll(~(used[i] | used[j]));
            used[i] |= 1ULL << color[k];
            used[j] |= 1ULL << color[k];
            colors = color[k] >= colors ? color[k] + 1 : colors;
        }
    return colors;
}
