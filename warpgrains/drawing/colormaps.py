"""Tables of colors."""

# Matplotlib's perceptually uniform colormaps, safe for color-blind readers, at 32 points of the range, for
# use without Matplotlib. Colors between are interpolated in sRGB; tests/usd/test_appearance.py bounds
# the error.
COLORS = {
    "viridis": """
        440154 470d60 48186a 482374 472e7c 453882 424186 3e4a89 3a548c 365d8d 32658e 2e6d8e 2b758e 287d8e
        25848e 228c8d 1f948c 1e9c89 20a386 25ab82 2eb37c 3aba76 48c16e 58c765 6ccd5a 7fd34e 93d741 a8db34
        c0df25 d5e21a eae51a fde725
    """,
    "cividis": """
        00224e 00285b 002e6a 053371 1c396f 293f6e 33446d 3c4a6c 45506c 4d556c 555b6d 5c616e 646770 6b6d72
        727274 787877 807f78 888578 908b78 979177 a09875 a89e73 b0a571 b9ab6d c2b369 cbb965 d3c05f dcc859
        e6d051 efd748 f8df3c fee838
    """,
    "plasma": """
        0d0887 220690 310597 3f049c 4e02a2 5b01a5 6700a8 7401a8 8104a7 8d0ba5 9814a0 a21d9a ad2793 b6308b
        bf3984 c7427c cf4c74 d6556d dd5e66 e3685f e97257 ef7c51 f3874a f79143 fa9e3b fca934 fdb52e fdc229
        fcd025 f9dd25 f5eb27 f0f921
    """,
    "managua": """
        ffcf67 f5bf62 ebb05d e1a158 d79152 cd844e c3774a b96c46 ae5f42 a3543f 97493c 8a3f3a 7c3639 702f3a
        652a3d 5c2843 542a4e 4f305b 4d376a 4c4179 4d4e8a 4f5a98 5266a5 5672b1 5b80bc 608dc6 659acf 6aa8d9
        70b8e3 76c7ec 7bd7f5 81e7ff
    """,
    "magma": """
        000004 030312 0a0822 130d34 1e1149 2a115c 38106c 451077 54137d 601880 6d1d81 792282 882781 942c80
        a1307e ae347b bd3977 ca3e72 d6456c e24d66 ec5860 f3655c f8745c fb835f fd9467 fea36f feb27a fec185
        fed194 fde0a1 fceeb0 fcfdbf
    """,
}
