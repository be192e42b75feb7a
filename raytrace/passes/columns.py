"""Memory for the records of columns that the passes read and write: one block for each thread."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import PACKET
from raytrace.accel.layout import aligned
from raytrace.records import Batch, Hits

BATCH_COLUMNS = 11  # of a Batch


class ColumnMemory:
    """One block of memory, given out column by column.

    Parameters
    ----------
    columns : int
    n : int
        Most samples of a batch.
    dtype : dtype

    Attributes
    ----------
    rows : int
        Numbers in a column: one packet more than a batch has samples. A batch often fills whole memory pages. Without
        the extra packet, all columns would then start at the same offset in a page, and compete for the same few cache
        lines.
    """

    def __init__(self, columns: int, n: int, dtype: np.dtype) -> None:
        self.rows = n + PACKET
        self._block, self._taken = aligned(columns * self.rows, dtype).reshape(columns, self.rows), 0

    def take(self, columns: int = 1, dtype: Any = None) -> NDArray[Any]:
        """Return the next columns as one flat array, of the block's type or of one that is no larger."""
        first, self._taken = self._taken, self._taken + columns
        taken = self._block[first : self._taken]
        return taken.reshape(-1).view(dtype or taken.dtype)[: taken.size]

    def take_batch(self) -> Batch:
        """Return a batch in the next `BATCH_COLUMNS` columns."""
        d, o, slot = self.take(3), self.take(3), self.take(dtype=np.int32)
        return Batch(o, d, slot, Hits(self.take(), self.take(dtype=np.int32), self.take(), self.take()))


def shortened_record(record: Any, rows: int, most: int) -> Any:
    """Return a record of columns of ``most`` rows as one of fewer rows, in the same memory."""
    return record._make(
        shortened_record(a, rows, most) if isinstance(a, tuple) else a if a is None else a[: len(a) // most * rows]
        for a in record
    )
