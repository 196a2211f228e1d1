"""Excerpts of other programs' files of stability derivatives, written by hand in the form that they document."""

from __future__ import annotations

#: AVL 3.40, OPER, ST: alpha 30 deg, where the sine is a half.
AVL = """\
 ---------------------------------------------------------------
 Vortex Lattice Output -- Total Forces

 Configuration: Mine
     # Surfaces =   4
     # Strips   =  70
     # Vortices = 700

  Sref =  0.3000       Cref = 0.25000       Bref =  1.2000
  Xref =  0.1000       Yref =  0.0000       Zref =  0.0000

 Standard axis orientation,  X fwd, Z down

 Run case:  -unnamed-

  Alpha =  30.00000     pb/2V =  -0.00000     p'b/2V =  -0.00000
  Beta  =   0.00000     qc/2V =   0.01000
  Mach  =     0.000     rb/2V =  -0.00000     r'b/2V =  -0.00000

  CXtot =   0.00826     Cltot =  -0.00000     Cl'tot =  -0.00000
  CYtot =  -0.00000     Cmtot =  -0.50000
  CZtot =  -2.50000     Cntot =   0.00000     Cn'tot =   0.00000

  CLtot =   2.50000
  CDtot =   0.00361
  CDvis =   0.00000     CDind = 0.0036066
  CLff  =   2.50000     CDff  = 0.0034584    | Trefftz
  CYff  =  -0.00000         e =    0.9000    | Plane

   flap            =   5.00000
   aileron         =   0.00000
   Elevator        =   2.00000
   rudder          =   0.00000

 ---------------------------------------------------------------

 Stability-axis derivatives...

                             alpha                beta
                  ----------------    ----------------
 z' force CL |    CLa =   4.500000    CLb =   0.000000
 y  force CY |    CYa =  -0.000000    CYb =  -0.300000
 x' mom.  Cl'|    Cla =  -0.000000    Clb =  -0.100000
 y  mom.  Cm |    Cma =  -0.900000    Cmb =   0.000000
 z' mom.  Cn'|    Cna =  -0.000000    Cnb =   0.040000

                     roll rate  p'      pitch rate  q'        yaw rate  r'
                  ----------------    ----------------    ----------------
 z' force CL |    CLp =  -0.000000    CLq =   8.000000    CLr =   0.000000
 y  force CY |    CYp =  -0.020000    CYq =   0.000000    CYr =   0.200000
 x' mom.  Cl'|    Clp =  -0.500000    Clq =   0.000000    Clr =   0.100000
 y  mom.  Cm |    Cmp =   0.000000    Cmq = -12.000000    Cmr =   0.000000
 z' mom.  Cn'|    Cnp =  -0.020000    Cnq =   0.000000    Cnr =  -0.200000

                  flap         d01     aileron      d02     Elevator     d03     rudder       d04
                  ----------------    ----------------    ----------------    ----------------
 z' force CL |   CLd01 =   0.030000  CLd02 =   0.000000  CLd03 =   0.006000  CLd04 =   0.000000
 y  force CY |   CYd01 =   0.000000  CYd02 =   0.000100  CYd03 =   0.000000  CYd04 =   0.003000
 x' mom.  Cl'|   Cld01 =   0.000000  Cld02 =  -0.004000  Cld03 =   0.000000  Cld04 =   0.000200
 y  mom.  Cm |   Cmd01 =  -0.010000  Cmd02 =   0.000000  Cmd03 =  -0.015000  Cmd04 =   0.000000
 z' mom.  Cn'|   Cnd01 =   0.000000  Cnd02 =   0.000300  Cnd03 =   0.000000  Cnd04 =  -0.001500
 Trefftz drag| CDffd01 =   0.000100 CDffd02 =   0.000000 CDffd03 =   0.000100 CDffd04 =   0.000000
 span eff.   |    ed01 =   0.000000    ed02 =   0.000000    ed03 =   0.000000    ed04 =   0.000000

 Neutral point  Xnp =   0.150000

 Clb Cnr / Clr Cnb  =   5.000000    (  > 1 if spirally stable )
"""

#: XFLR5 6, log of a stability analysis: alpha 30 deg, the same lateral derivatives.
XFLR5 = """\
      Calculation for control position 0.00
   Mass=       1.000 kg

      Searching for zero-moment angle... Alpha=30.00000°
      Calculating speed to balance the weight...VInf = 12.00000 m/s

      ___Inertia - Stability Axis - CoG Origin____
      Isxx=    0.004001

      Longitudinal derivatives
      Xu=   -0.028858         Cxu=   -0.039385
      Xw=      0.1091         Cxa=     0.14889
      Zu=    -0.42128         Czu=   0.0028013
      Zw=     -3.1536         CLa=         4.5
      Zq=    -0.44812         CLq=           8
      Mu= -0.00050102         Cmu=  -0.0038824
      Mw=   -0.081849         Cma=        -0.9
      Mq=   -0.098813         Cmq=         -12
      Neutral Point position=   0.08595 m


      Lateral derivatives
      Yv=    -0.61866         CYb=        -0.3
      Yp=    0.011975         CYp=       -0.02
      Yr=     0.26989         CYr=         0.2
      Lv=   -0.044646         Clb=        -0.1
      Lp=   -0.090387         Clp=        -0.5
      Lr=    0.019467         Clr=         0.1
      Nv=     0.21312         Cnb=        0.04
      Np=   -0.037193         Cnp=     -2.0e-2
      Nr=   -0.097294         Cnr=        -0.2

      Control derivatives
      Xde=   -0.077213        CXde=    -0.01229
      Yde= -4.8915e-06        CYde=  -7.786e-07
      Zde=     -5.8507        CZde=    -0.93128
      Lde= -2.4741e-08        CLde= -4.9226e-09
      Mde=     -1.9823        CMde=     -1.7916
      Nde= -3.8288e-06        CNde= -7.6181e-07
"""

#: Of AeroSandbox's run_with_stability_derivatives, arrays as lists of one number.
AEROSANDBOX = {
    "CL": [0.4], "CD": [0.03], "Cm": [0.01], "x_np": [0.15],
    "CLa": [4.5], "CDa": [0.2], "CYa": [0.0], "Cla": [0.0], "Cma": -0.9, "Cna": [0.0],
    "CLb": 0.0, "CYb": -0.3, "Clb": -0.1, "Cmb": 0.0, "Cnb": 0.04,
    "CLp": 0.0, "CYp": -0.02, "Clp": -0.5, "Cmp": 0.0, "Cnp": -0.02,
    "CLq": [[8.0]], "CYq": 0.0, "Clq": 0.0, "Cmq": -12, "Cnq": 0.0,
    "CLr": 0.0, "CYr": 0.2, "Clr": 0.1, "Cmr": 0.0, "Cnr": -0.2,
}  # fmt: skip
