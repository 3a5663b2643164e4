"""Codes of the instructions of a program.

A program is a list of scalar instructions in static single assignment: instruction i writes
register i and reads registers before it. The first three registers are the coordinates.
"""

X, Y, Z, CONST, LEAF = 0, 1, 2, 3, 4  # inputs; LEAF reads values computed elsewhere
INPUTS = 5  # codes from here on compute

NEG, ABS, SQRT, SQUARE, SIN, COS, TAN, ASIN, ACOS, ATAN = range(5, 15)
SINH, COSH, TANH, EXP, LOG, SIGN, FLOOR, CEIL = range(15, 23)
BINARY = 23  # codes from here on read two registers
ADD, SUB, MUL, DIV, MIN, MAX, POW, ATAN2, MOD, WRAP = range(23, 33)

KINKED = frozenset({ABS, SQRT, SIGN, FLOOR, CEIL, MIN, MAX, POW, ATAN2, MOD, WRAP})
COMMUTES = frozenset({ADD, MUL})  # minima and maxima have the slope of the first of equals
