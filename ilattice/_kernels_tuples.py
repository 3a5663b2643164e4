"""Named tuples of arrays as arguments of kernels, without the cost of counting references.

A kernel that takes twenty arrays one by one cannot be read. In a tuple they have names, but each
one that is taken out of it costs two atomic operations, because the tuple may be gone before.

Guarantee: the arrays are the same. Non-guarantee: that they still exist, see `borrowed`.
"""

from typing import Any

from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic

_config: Any = config


def _same(bundle: Any) -> Any:
    """See `borrowed`, where nothing is compiled."""
    return bundle


def _borrow(typing: Any, bundle: Any) -> Any:
    """See `borrowed`: the tuple without the owners of its arrays."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        out = arguments[0]
        for i, kind in enumerate(signature.args[0].types):
            if not isinstance(kind, types.Array):
                continue
            array = context.make_array(kind)(context, builder, builder.extract_value(out, i))
            array.meminfo = ir.Constant(array.meminfo.type, None)
            out = builder.insert_value(out, array._getvalue(), i)
        return out

    return bundle(bundle), generate


#: Of compiled code: the same tuple, references to the arrays of which nobody counts. Only for what
#: came as an argument, as the caller holds it; what a kernel has allocated itself would be freed
#: after it was last named, which this is not.
borrowed: Any = _same if _config.DISABLE_JIT else intrinsic(_borrow)
